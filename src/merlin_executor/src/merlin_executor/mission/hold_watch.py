# SPDX-License-Identifier: Apache-2.0
"""Whether the Executor waits for the release of a base; missions wait, too."""

import threading
from typing import Callable

import rospy
from merlin_msgs.msg import ExecutorStatus

from merlin_ros.deadline import Deadline


class HoldWatch:
    """Follows ``merlin/status``.

    :param changed: guards its fields, and is notified when the Executor has said something.
    """

    def __init__(self, changed: threading.Condition) -> None:
        self._changed = changed
        self.waits = ""
        """What the Executor waits for, a sentence; empty: no base is held."""
        self.releases = 0
        """How many holds have ended so far."""
        self._status = rospy.Subscriber("merlin/status", ExecutorStatus, self._receive, tcp_nodelay=True)

    def wait_released(self, tell: Callable[[str], None]) -> None:
        """Waits until no base is held, or the node shuts down.

        :param tell: called with what it waits for, unless it does not wait.
        """
        with self._changed:
            if self.waits:
                tell(self.waits)
            Deadline(None).wait(self._changed, lambda: not self.waits)

    def close(self) -> None:
        """Ends its subscription."""
        self._status.unregister()

    def _receive(self, status: ExecutorStatus) -> None:
        with self._changed:
            self.releases += bool(self.waits and not status.waits)
            self.waits = status.waits
            self._changed.notify_all()
