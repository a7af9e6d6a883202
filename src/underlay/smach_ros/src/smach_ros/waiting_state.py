# SPDX-License-Identifier: Apache-2.0
"""What the states that wait for something have in common: a preempt ends the wait at once."""

import threading
from typing import Any, Callable

import rospy

import smach
from smach.execution import run_context
from smach.log import wake_at_shutdown


class ReportingState(smach.State):
    """A state that keeps what went wrong. A subclass implements :meth:`_execute`.

    :ivar reason: of the last run, as a sentence; empty: nothing went wrong.
    """

    reason = ""
    _what = ""  # what it calls or watches, with its name

    def execute(self, ud: Any) -> str:
        """Runs the state; returns its outcome."""
        self.reason = ""
        by_container = run_context.begin_run(self)
        try:
            return self._execute(ud)
        finally:
            run_context.end_run(self, by_container)

    def _execute(self, ud: Any) -> str:
        raise NotImplementedError

    def _report(self, text: str, log: Callable[[str], None] = rospy.logerr) -> None:
        """Logs what went wrong; its first line, and the last one of a traceback, are the reason."""
        text = f"{self._what}: {text}"
        log(text)
        first, *rest = text.strip().splitlines()
        self.reason = f"{first}: {rest[-1]}" if rest else first


class WaitingState(ReportingState):
    """A state whose waits end with a preempt and with the shutdown of the node.

    A subclass waits on ``_changed``. Parameters: as of ``smach.State``.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._changed = threading.Condition(threading.RLock())  # wakes the wait
        wake_at_shutdown(self._changed)

    def request_preempt(self) -> None:
        """Ends the wait at once."""
        super().request_preempt()
        with self._changed:
            self._changed.notify_all()
