# SPDX-License-Identifier: Apache-2.0
"""Waits for ROS time without polling, and ends a wait at once when its stop event is set."""

import threading

import rospy

from merlin_ros.ros_alarm import RosStopwatch

ROUNDING = 1e-6  # s; sums of ticks are not exact


class RosClock:
    """ROS time to wait for: simulated time as its messages come, wall time otherwise."""

    def __init__(self) -> None:
        self._ticked = rospy.rostime.get_rostime_cond()  # notified at each tick of /clock, and by wake()

    def wait(self, seconds: float, stop: threading.Event) -> bool:
        """Waits for seconds of ROS time; False when `stop` was set (see :meth:`wake`) or ROS shut down."""
        passed = RosStopwatch()
        with self._ticked:
            while (left := seconds - passed.look()) > ROUNDING:
                if stop.is_set() or rospy.is_shutdown():
                    return False
                # The slice is for shutdown, which does not notify this condition.
                self._ticked.wait(min(left, 1.0) if rospy.rostime.is_wallclock() else 1.0)
        return not stop.is_set()

    def wake(self) -> None:
        """Wakes every wait, so that it re-checks its stop event."""
        with self._ticked:
            self._ticked.notify_all()
