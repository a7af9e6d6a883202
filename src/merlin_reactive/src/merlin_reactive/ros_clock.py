# SPDX-License-Identifier: Apache-2.0
"""Waits for ROS time without polling, and ends a wait at once when its stop event is set."""

import threading

import rospy
from rosgraph_msgs.msg import Clock

from merlin_ros.ros_alarm import RosStopwatch

ROUNDING = 1e-6  # s; sums of ticks are not exact


class RosClock:
    """ROS time to wait for: simulated time as its messages come, wall time otherwise."""

    def __init__(self) -> None:
        self._ticked = threading.Condition()  # guards the waiting; notified at each tick and by wake()
        self._simulated = bool(rospy.get_param("/use_sim_time", False))
        if self._simulated:
            self._subscriber = rospy.Subscriber("/clock", Clock, self._tick, tcp_nodelay=True, queue_size=1)

    def wait(self, seconds: float, stop: threading.Event) -> bool:
        """Waits for seconds of ROS time; False when `stop` was set (see :meth:`wake`) or ROS shut down."""
        passed = RosStopwatch()
        with self._ticked:
            while (left := seconds - passed.look()) > ROUNDING:
                if stop.is_set() or rospy.is_shutdown():
                    return False
                # The slice is for shutdown, which does not notify this condition.
                self._ticked.wait(1.0 if self._simulated else min(left, 1.0))
        return not stop.is_set()

    def wake(self) -> None:
        """Wakes every wait, so that it re-checks its stop event."""
        with self._ticked:
            self._ticked.notify_all()

    def _tick(self, _: Clock) -> None:
        with self._ticked:
            self._ticked.notify_all()
