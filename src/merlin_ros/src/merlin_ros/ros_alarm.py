# SPDX-License-Identifier: Apache-2.0
"""ROS time that passes, and an alarm in it: wall or simulated, also when its clock is set."""

import math
import threading
import time
from typing import Callable, Optional

import rospy

from merlin_ros.work.passed_time import PassedTime
from merlin_ros.work.threads import failure_logged, start_thread

LONGEST = 60.0  # s that the alarm sleeps at once: a wall clock that is set forward is seen by then


class RosStopwatch:
    """ROS time that has passed since it was made. Not thread-safe.

    A wall clock may be set, by NTP for example, so the monotonic clock counts what passes by it. A simulated
    clock that jumps back takes nothing away, and where it begins nothing has passed.
    """

    def __init__(self) -> None:
        self._time = PassedTime(0.0)
        self.look()

    def look(self) -> float:
        """What has passed, s."""
        now = time.monotonic() if rospy.rostime.is_wallclock() else rospy.get_time()
        if not self._time.now:  # it begins, or a simulated clock does
            self._time.set(now)
        return self._time.look(now)


class RosAlarm:
    """Calls back once when a ROS time has come, or so much has passed; setting it again moves it.

    :param callback: called in the alarm's own thread.
    :param name: of that thread.
    """

    def __init__(self, callback: Callable[[], None], name: str) -> None:
        self._callback = callback
        self._name = name
        self._changed = threading.Condition()  # guards the fields below
        self._asked: Optional[float] = None  # ROS time; infinite: it may not come earlier than `_end`
        self._end = 0.0  # of the stopwatch
        self._passed = RosStopwatch()
        self._stopping = False
        self._thread: Optional[threading.Thread] = None

    def set(self, when: Optional[float]) -> None:
        """Rings at a ROS time, s; None: not at all. A time that is past rings at once."""
        with self._changed:
            if when == self._asked:
                return
            self._put(when, 0.0 if when is None else when - rospy.get_time())
        self._poke()

    def set_after(self, seconds: float) -> None:
        """Rings after so much ROS time, s, however a wall clock is set meanwhile."""
        with self._changed:
            self._put(math.inf, seconds)
        self._poke()

    def _put(self, when: Optional[float], seconds: float) -> None:
        self._asked, self._end = when, self._passed.look() + seconds
        if when is not None and self._thread is None:
            self._thread = start_thread(self._name, self._run)
        self._changed.notify_all()

    def shutdown(self) -> None:
        """Ends the thread."""
        with self._changed:
            self._stopping = True
            self._asked = None
            self._changed.notify_all()
        self._poke()

    def _left(self, asked: float) -> float:
        """ROS time until it rings, s; a moment comes earlier where the clock is set forward."""
        left = self._end - self._passed.look()
        return left if asked == math.inf else min(left, asked - rospy.get_time())

    @staticmethod
    def _poke() -> None:
        if not rospy.rostime.is_wallclock():
            condition = rospy.rostime.get_rostime_cond()
            with condition:
                condition.notify_all()

    def _run(self) -> None:
        while not rospy.is_shutdown():
            with self._changed:
                while self._asked is None and not self._stopping:
                    self._changed.wait()
                if self._stopping or self._asked is None:
                    return
                left = self._left(self._asked)
                due = left <= 0
                if due:
                    self._asked = None
                elif rospy.rostime.is_wallclock():
                    self._changed.wait(min(LONGEST, left))
            if due:
                with failure_logged(self._name):  # the alarm is set again, by whatever else happens
                    self._callback()
            elif not rospy.rostime.is_wallclock():
                condition = rospy.rostime.get_rostime_cond()
                with condition:
                    condition.wait(0.5)  # every tick of /clock notifies; the limit is for shutdown


def call_after(seconds: float, call: Callable[[], None], name: str) -> RosAlarm:
    """Calls once after some ROS time, also when the clock is set meanwhile; rospy's timer dies of that.

    :param seconds: s of ROS time.
    :param name: of the thread that calls.
    :return: the alarm; its shutdown prevents the call, and ends the thread at once.
    """

    def ring() -> None:
        alarm.shutdown()
        call()

    alarm = RosAlarm(ring, name)
    alarm.set_after(seconds)
    return alarm
