# SPDX-License-Identifier: Apache-2.0
"""Whether a base stands, or is held: the verdict on a stop, and who holds it since when. Without ROS."""

import time
from typing import NamedTuple, Sequence

from merlin_executor.core.outcome import Outcome, Verdict

#: Longest wait for the base to stand after everything has ended, s of running time.
STAND_WAIT = 0.5
MOVES = "the base still moves"


CALENDAR = 1e8  # s; less is the time of a simulator, which began at zero


def clock_text(at: float) -> str:
    """``123.4 s`` in a simulation, else the time of the day."""
    return f"{at:.1f} s" if at < CALENDAR else time.strftime("%H:%M:%S", time.localtime(at))


def holder_of(reason: str) -> str:
    """Who stopped a base, of the guard's reason; empty: it names no operator (``stopped on the topic …``)."""
    return reason.partition("stopped by ")[2]


def hold_words(robot: str, reason: str, since: float) -> str:
    """Who holds a base since when: ``the base is held by Ana since 14:03:07``.

    :param robot: its name; empty: there is one base.
    :param reason: of its guard.
    :param since: s of ROS time.
    """
    how = reason.partition("stopped ")[2] or reason
    return f"{f'robot {robot}' if robot else 'the base'} is held {how} since {clock_text(since)}"


class Halt(NamedTuple):
    """The result of a request to the guard to halt the base."""

    guard: bool
    """Whether there is a guard that could halt the base."""
    halted: bool = False
    """The guard has halted the base."""
    message: str = ""
    """Its own words, or why it did not answer."""

    @property
    def words(self) -> str:
        """The text as part of a sentence."""
        if not self.guard:
            return "no guard runs that could halt the base"
        if self.halted:
            return "the guard has halted the base"
        return f"the guard could not halt the base: {self.message or 'it gave no reason'}"


def together(halts: Sequence[Halt]) -> Halt:
    """The result for several bases: all of those that have a guard have to stand."""
    guarded = [halt for halt in halts if halt.guard]
    if not guarded:
        return halts[0]
    return next((halt for halt in guarded if not halt.halted), guarded[0])


def unstopped(names: Sequence[str], halt: Halt, story: str = "") -> Verdict:
    """The verdict on a run of which something did not stop.

    :param names: what did not stop, as PDDL text.
    :param story: a sentence that says so already, or why it had to stop; empty: its client wanted it to.
    """
    text = f"{', '.join(names)} did not stop"
    if story:
        text = story if "did not" in story else f"{story}; {text}"
    return Verdict(Outcome.CANCEL_TIMEOUT, f"{text}; {halt.words}", ", ".join(names))


def still_moving(verdict: Verdict, halt: Halt) -> Verdict:
    """The verdict on a run that has ended while the base still moves.

    A cancel is not complete before the base stands; a failure stays the failure that it was.
    """
    if verdict.outcome is Outcome.CANCELLED:
        return Verdict(Outcome.CANCEL_TIMEOUT, f"{MOVES} although all actions have ended; {halt.words}")
    return verdict._replace(reason=f"{verdict.reason}; {MOVES}, {halt.words}")
