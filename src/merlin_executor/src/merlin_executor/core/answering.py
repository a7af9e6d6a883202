# SPDX-License-Identifier: Apache-2.0
"""How the end of a request is told: to its client, in the log, in the health of the Executor. Pure."""

import threading
from enum import Enum
from typing import Dict, NamedTuple, Sequence, Union

from merlin_executor.core.agenda import NOT_BEGUN
from merlin_executor.core.outcome import Outcome, Verdict

LONGEST_REASON = 2000  # characters of the last reason


def end_words(goals: Sequence[str], verdict: Verdict) -> str:
    """Which request has ended, and how, as a sentence."""
    return f"{', '.join(goals)}: {verdict.reason or 'done'}"[:LONGEST_REASON]


class ActivityReport(NamedTuple):
    """The health of an Executor."""

    ill: bool
    text: str
    values: Dict[str, Union[int, str]]


class Activity:
    """Remembers how the last request has ended; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards both fields
        self._reason = ""
        self._ill = False

    @property
    def reason(self) -> str:
        """Which request ended last, and how; empty: none yet."""
        with self._lock:
            return self._reason

    def ended(self, goals: Sequence[str], verdict: Verdict) -> str:
        """A request has ended; returns the new :attr:`reason`."""
        with self._lock:
            self._ill = verdict.outcome.of_software
            self._reason = end_words(goals, verdict)
            return self._reason

    def report(self, running: Sequence[str], waiting: int) -> ActivityReport:
        """The health now; ill when the last request has failed for a reason that is not the world's.

        :param running: goals of the requests that run.
        :param waiting: number of the requests that wait.
        """
        with self._lock:
            reason, ill = self._reason, self._ill
        doing = f"running {', '.join(running)}" if running else "idle"
        values: Dict[str, Union[int, str]] = {"waiting requests": waiting, "last request": reason}
        return ActivityReport(ill, f"{doing}; last: {reason}" if ill else doing, values)


class ClientAnswer(Enum):
    """The methods of a goal of an action server that end it."""

    SUCCEED = "succeed"
    CANCEL = "cancelled"
    REJECT = "reject"
    ABORT = "abort"


def answer_for(outcome: Outcome, accepted: bool) -> ClientAnswer:
    """The verb for an outcome.

    :param accepted: whether the client got the state ACTIVE; such a request cannot be rejected.
    """
    if outcome.achieved:
        return ClientAnswer.SUCCEED
    if outcome in (Outcome.CANCELLED, Outcome.DROPPED):
        return ClientAnswer.CANCEL
    if outcome in (Outcome.REFUSED, Outcome.LATE) and not accepted:
        return ClientAnswer.REJECT
    return ClientAnswer.ABORT


def unreadable(reason: str, cancelled: bool = False) -> Verdict:
    """On a request that could not be read, or not be checked.

    :param reason: a sentence.
    :param cancelled: its client has taken it back meanwhile.
    """
    if cancelled:
        return Verdict(Outcome.CANCELLED, f"{NOT_BEGUN}; {reason}")
    return Verdict(Outcome.REFUSED, reason)
