# SPDX-License-Identifier: Apache-2.0
"""What a mission does when the Executor is lost while its goal runs: send it again, or end. Pure.

A goal that has ended because the mission itself was silent, as its process was stopped, is lost as well.
A goal says what shall hold, so sending it again is harmless: what holds already ends at once. One that an
Executor never took, because it died in that moment, is sent to the next one in any case.
"""

import time
from typing import Callable, Optional

from merlin_executor.core.agenda import client_was_lost
from merlin_executor.core.awaited import Absence
from merlin_executor.core.outcome import Outcome, StopKind, Verdict
from merlin_ros.work.goal_end import GoalEnd

#: The goal ends with the reason.
END = "end"
#: The goal is sent again when the Executor is back.
RESEND = "resend"
ON_LOST = (END, RESEND)

#: Longest wait for the return of an Executor, s of running time.
RETURN_WAIT = 30.0
#: The same for a goal that ends when the Executor is lost, and that was never taken.
UNTAKEN_WAIT = 8.0
#: How often one goal is sent again.
RESENDS = 5


def checked(on_lost: str) -> str:
    """Returns a word of :data:`ON_LOST`.

    :raises ValueError: for another word.
    """
    if on_lost not in ON_LOST:
        raise ValueError(f"on_lost is {on_lost!r}; it has to be one of {', '.join(ON_LOST)}")
    return on_lost


#: Text of an action server that ends its goals.
_SERVER_ENDS = "the action server shuts down"


def was_lost(status: int, text: str, reason: str) -> bool:
    """Whether a goal has ended because the Executor is gone, goes down, or has missed this client.

    :param status: as of :class:`.GoalEnd`.
    :param text: of that status.
    :param reason: in the Executor's result; empty: it gives none.
    """
    ends = reason.startswith(StopKind.SHUTDOWN.value) or text == _SERVER_ENDS
    return status == GoalEnd.LOST or ends or client_was_lost(reason)


def was_begun(active: bool, status: int, lost: bool) -> bool:
    """Whether the Executor had begun a goal that has ended.

    :param active: it said so while the goal ran.
    :param status: as of :class:`.GoalEnd`.
    :param lost: as of :func:`was_lost`; an action server that goes down aborts what waits, too.
    """
    ran = (GoalEnd.PREEMPTED, GoalEnd.SUCCEEDED)
    return active or status in ran or (status == GoalEnd.ABORTED and not lost)


class Resending:
    """One goal of a client. Not thread-safe; nothing is decided after its end.

    :param on_lost: :data:`END` or :data:`RESEND`.
    :param clock: s, never set back.
    :param survives: the next Executor carries it out, also when it is not sent again: then a cancel has to
        reach that one.
    :raises ValueError: for another word.
    """

    def __init__(
        self, on_lost: str = END, clock: Callable[[], float] = time.monotonic, survives: bool = False
    ) -> None:
        self._clock = clock
        self._survives = survives
        self._absence = Absence()
        self._resend = checked(on_lost) == RESEND
        self.cancelled = False
        """Whether it was cancelled."""
        self.sent_again = 0
        """How often it was sent again."""
        self.patience = 0.0
        """Longest wait for the return of the Executor that is gone, s of the clock."""

    def cancel(self) -> None:
        """The client no longer wants the goal."""
        self.cancelled = True

    def leave(self) -> None:
        """The client no longer waits for it, and what survives goes on."""
        self._survives = False
        self.cancelled = True

    @property
    def given_up(self) -> bool:
        """Whether nothing is left to do for it while the Executor is gone."""
        return self.cancelled and not self._survives

    @property
    def _limit(self) -> float:
        return RETURN_WAIT if self._resend else UNTAKEN_WAIT

    def ended(self, lost: bool, untaken: bool = False) -> Optional[str]:
        """The goal has ended at the Executor.

        :param lost: as of :func:`was_lost`.
        :param untaken: an Executor ran, and never acknowledged the goal.
        :return: why it ends, as a sentence; empty: the Executor's own reason stands. None: the return of the
            Executor is waited for.
        """
        if lost and untaken and self.given_up:
            return "cancelled before the executor took it"
        if not lost or not (self._resend or untaken) or self.given_up:
            return ""
        left = self._absence.lost(self._clock(), self._limit)
        if self.sent_again >= RESENDS or left is None:
            return f"the goal was lost {self.sent_again + 1} times"
        self.patience = left
        return None

    def executor(self, is_there: bool) -> Optional[str]:
        """The wait for the Executor is over.

        :return: why the goal ends, as a sentence; None: it is to be sent again.
        """
        self._absence.back(self._clock())
        if self.given_up:
            return "cancelled while the executor was gone"
        if not is_there:
            goes_on = "; it may go on when the executor returns" if self._survives else ""
            return f"the executor is gone and did not return within {self._limit:g} s{goes_on}"
        self.sent_again += 1
        return None

    def verdict(self, status: int, text: str, reason: str, said: str) -> Optional[Verdict]:
        """What the client of a goal that has ended is answered; None: the Executor's own result.

        :param status, text, reason: as of :func:`was_lost`.
        :param said: why the goal was ended here; empty: it was not.
        """
        if status == GoalEnd.LOST or said:
            outcome = Outcome.CANCELLED if self.given_up and said else Outcome.INTERNAL
            return Verdict(outcome, said or text)
        # Without a reason the action server has answered for the Executor.
        if status == GoalEnd.RECALLED and not reason:
            return Verdict(Outcome.CANCELLED, text)
        if status == GoalEnd.ABORTED and not reason:
            return Verdict(Outcome.INTERNAL, text)
        return None
