# SPDX-License-Identifier: Apache-2.0
"""The health of a node's parts on ``/diagnostics`` (diagnostic_msgs), once per second of wall time.

Wall time, so that a paused simulator does not look like a dead node. A node that ends in order says so last:
a recording has no other sign of it.
"""

import contextlib
import threading
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional

import diagnostic_updater  # imported where it is used: a node answers before that
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from rospy.core import is_shutdown_requested

from merlin_ros.publishing import writable
from merlin_ros.work.threads import failure_text, start_thread

PERIOD = 1.0  # s of wall time
#: Message of each part when its node ends in order; the level is `STALE`.
ENDED = "the node has ended"
LAST_WORD = 0.5  # s of wall time that the end waits for it: a check may hang

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE


class Health(NamedTuple):
    """State of a part: `OK`, `WARN` or `ERROR`, a sentence, and figures for diagnosis."""

    level: int = OK
    message: str = "ready"
    values: Mapping[str, object] = {}


class HealthReporter:
    """Asks every part how it does and publishes the answers.

    :param checks: by name of the part; called in one thread, must not block.
    """

    def __init__(self, checks: Dict[str, Callable[[], Health]]) -> None:
        self._checks = checks
        self._stopped = threading.Event()
        self._thread: Optional[threading.Thread] = None

    def start(self) -> None:
        """Begins to publish; ends with the node."""
        rospy.on_shutdown(self.stop)
        # Of its own: a check of an application may hang.
        self._thread = start_thread("health", self._report)

    def stop(self) -> None:
        """Publishes that the node has ended, and no more."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(LAST_WORD)

    def _report(self) -> None:
        updater: Any = None
        while not self._stopped.is_set():
            try:
                updater = updater or self._updater()
                updater.force_update()
            except Exception as error:
                # A part may have said what no message can carry; its next text may be another.
                if is_shutdown_requested():
                    return
                rospy.logerr_throttle(60.0, f"the health of this node cannot be published: {error!r}")
            self._stopped.wait(PERIOD)
        with contextlib.suppress(Exception):  # the topic is closed: the end did not wait for this
            if updater is not None:
                updater.broadcast(STALE, ENDED)

    def _updater(self) -> Any:
        updater = diagnostic_updater.Updater()
        updater.setHardwareID("none")
        for name, check in self._checks.items():
            updater.add(name, _task(check))
        return updater


def _task(check: Callable[[], Health]) -> Callable[[Any], Any]:
    def fill(status: Any) -> Any:  # a DiagnosticStatusWrapper
        try:
            health = check()
        except Exception as error:  # a part that raises is ill, and the others are still asked
            health = Health(ERROR, f"no report: {failure_text(error)}")
        status.summary(health.level, writable(str(health.message)))
        for key, value in health.values.items():
            status.add(key, writable(str(value)))
        return status

    return fill
