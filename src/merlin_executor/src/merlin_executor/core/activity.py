# SPDX-License-Identifier: Apache-2.0
"""The health of the Executor: the last reason, and whether its software needs attention. Pure."""

import threading
from typing import Dict, NamedTuple, Sequence, Union

from merlin_executor.core.outcome import Verdict

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
