# SPDX-License-Identifier: Apache-2.0
"""An alarm at a ROS time: woken by the clock that ROS uses, wall or simulated, also when it jumps back."""

import threading
import time
from typing import Callable, Optional

import rospy

from merlin_ros.work.passed_time import PassedTime
from merlin_ros.work.threads import log_failure, start_thread

LONGEST = 60.0  # s that the alarm sleeps at once: a wall clock that is set forward is seen by then


class RosAlarm:
    """Calls back once when a ROS time has come; setting it again moves it.

    :param callback: called in the alarm's own thread.
    :param name: of that thread.
    """

    def __init__(self, callback: Callable[[], None], name: str) -> None:
        self._callback = callback
        self._name = name
        self._changed = threading.Condition()  # guards the fields below
        self._asked: Optional[float] = None
        self._when: Optional[float] = None  # `_asked`, of ROS time as it passes
        self._time = PassedTime(0.0)
        self._ticks = time.monotonic()  # s, at its last look
        self._stopping = False
        self._thread: Optional[threading.Thread] = None

    def set(self, when: Optional[float]) -> None:
        """Rings at a ROS time, s; None: not at all. A time that is past rings at once."""
        with self._changed:
            if when == self._asked:
                return
            self._look()
            self._asked = when
            self._when = None if when is None else self._time.at(when)
            if when is not None and self._thread is None:
                self._thread = start_thread(self._name, self._run)
            self._changed.notify_all()
        self._poke()

    def shutdown(self) -> None:
        """Ends the thread."""
        with self._changed:
            self._stopping = True
            self._asked = self._when = None
            self._changed.notify_all()
        self._poke()

    def _look(self) -> float:
        """ROS time as it passes, s; where a wall clock was set back, what passed meanwhile counts."""
        now, ticks, self._ticks = rospy.get_time(), self._ticks, time.monotonic()
        if not self._time.now:  # a simulated clock begins
            self._time.set(now)
        return self._time.look(now, self._ticks - ticks if rospy.rostime.is_wallclock() else 0.0)

    @staticmethod
    def _poke() -> None:
        if not rospy.rostime.is_wallclock():
            condition = rospy.rostime.get_rostime_cond()
            with condition:
                condition.notify_all()

    def _run(self) -> None:
        while not rospy.is_shutdown():
            with self._changed:
                while self._when is None and not self._stopping:
                    self._changed.wait()
                if self._stopping or self._when is None:
                    return
                left = self._when - self._look()
                due = left <= 0
                if due:
                    self._asked = self._when = None
                elif rospy.rostime.is_wallclock():
                    self._changed.wait(min(LONGEST, left))
            if due:
                try:
                    self._callback()
                except Exception:  # the alarm is set again, by whatever else happens
                    log_failure(self._name)
            elif not rospy.rostime.is_wallclock():
                condition = rospy.rostime.get_rostime_cond()
                with condition:
                    condition.wait(0.5)  # every tick of /clock notifies; the limit is for shutdown


def call_after(seconds: float, call: Callable[[], None], name: str) -> RosAlarm:
    """Calls once after some ROS time, also when the clock jumps back meanwhile; rospy's timer dies of that.

    :param seconds: s of ROS time.
    :param name: of the thread that calls.
    :return: the alarm; its shutdown prevents the call, and ends the thread at once.
    """

    def ring() -> None:
        alarm.shutdown()
        call()

    alarm = RosAlarm(ring, name)
    alarm.set(rospy.get_time() + seconds)
    return alarm
