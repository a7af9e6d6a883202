# SPDX-License-Identifier: Apache-2.0
"""The robot's clock against the hub's: a robot whose clock is wrong leaves deadlines alone."""

import time
from typing import TYPE_CHECKING, Optional

from merlin_fleet.core import events as ev

if TYPE_CHECKING:
    from merlin_fleet.core.agent import Agent

#: s by which a clock may differ from the hub's.
CLOCK_MARGIN = 10.0
TRIES = 5  # unanswered questions after which a hub counts as one that gives no time
AHEAD = "its clock is ahead of the hub's"
BEHIND = "its clock is behind the hub's"


def difference(off: float) -> str:
    """By how much a clock is off, in words.

    :param off: s; more than 0: it is ahead.
    """
    return f"{abs(off):.0f} s {'ahead of' if off > 0 else 'behind'} the hub's"


def moment(at: float) -> str:
    """A moment that a record names, by the local clock.

    :param at: s since 1970; any number, as records come from other machines.
    """
    try:
        return time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(at))
    except (OverflowError, ValueError, OSError):
        return f"{at:g} s since 1970"


class ClockCheck:
    """Compares the clocks. Between two answers the hub's time is counted by a clock that is never set."""

    def __init__(self, agent: "Agent") -> None:
        self._agent = agent
        self._hub_offset: Optional[float] = None  # what added to `now` is the hub's time, s since 1970
        self._unanswered = 0
        self._asking = False
        self._ask_at = 0.0
        self._said = 0.0
        self.problem = ""
        """How far the clock is off, in words; empty: it is not, or the hub's time is not known."""

    @property
    def refusal(self) -> str:
        """Why deadlines are left alone; empty: they are not."""
        if self._hub_offset is None and self._unanswered < TRIES:
            return "its clock was not yet compared with the hub's"
        if not self._wrong():
            return ""
        return AHEAD if self._off() > 0 else BEHIND

    def ask_anew(self) -> None:
        """The hub may be another one."""
        self._ask_at = self._agent.now

    def timed(self, event: ev.Timed) -> None:
        """The hub has answered what its time is, or has not."""
        agent, rules = self._agent, self._agent.rules
        self._asking = False
        if event.wall is not None:
            self._hub_offset, self._unanswered = event.wall - event.at, 0
        elif agent.usable:
            self._unanswered += 1
            if self._unanswered >= TRIES and self._hub_offset is None:
                agent.say("the hub does not tell its time: this robot's clock is not compared with it")
        known = self._hub_offset is not None or self._unanswered >= TRIES
        self._ask_at = agent.now + (rules.clock_every if known else rules.retry)

    def decide(self) -> None:
        """Asks for the hub's time; says when the clock is off, and when it agrees again."""
        agent = self._agent
        if agent.usable and not self._asking and agent.now >= self._ask_at:
            self._asking = True
            agent.decided.append(ev.AskTime())
        off, wrong = self._off(), self._wrong()
        if wrong and (not self.problem or abs(off - self._said) > agent.rules.clock_margin):
            self._said, self.problem = off, f"this robot's clock is {difference(off)}"
            agent.decided.append(ev.Say(f"{self.problem}: it takes no goal with a deadline, and ends none"))
        elif self.problem and not wrong:
            self.problem = ""
            agent.decided.append(ev.Say("this robot's clock agrees with the hub's again: deadlines count"))

    def _wrong(self) -> bool:
        return abs(self._off()) > self._agent.rules.clock_margin

    def _off(self) -> float:
        """s by which the clock is ahead of the hub's; 0 where that is not known."""
        return 0.0 if self._hub_offset is None else self._agent.wall_offset - self._hub_offset
