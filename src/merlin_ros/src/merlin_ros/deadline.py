# SPDX-License-Identifier: Apache-2.0
"""Deadlines on software: they run on the monotonic clock and stand still while the simulator is paused.

A paused simulator stops ``/clock``: servers that time themselves by ROS time fall silent and look dead. So
waits for software count *running time*, the monotonic time less the time spent paused. Where ROS time is no
simulator's, or goes on, nothing is paused, whatever the topic says. Below a simulator that is not MERLIN's,
which says nothing of a pause, running time is as slow as ``/clock``, down to :data:`SLOWEST`. A wait counts
the ticks of the thread that waits (:mod:`.alarms`): what that thread misses comes on top.
"""

import math
import threading
import time
from typing import Any, Callable, Optional

import rospy
from merlin_msgs.msg import SimStatus

from merlin_ros.alarms import INSTANT, TICK, Alarm, Alarms, TickClock
from merlin_ros.master.master_link import lost

SIM_STATUS_TOPIC = "/merlin_sim/status"
SLOWEST = 0.1  # s of running time per s of wall time, where no simulator says that it is paused
AHEAD = 0.5  # s by which ROS time, which comes in steps, may be ahead of running time, or behind it
LONGEST_SLEEP = 1.0  # s of wall time between two looks for a shutdown where nothing else passes


def simulated() -> bool:
    """Whether ROS time is a simulator's: ``/use_sim_time`` was set when this node began.

    On a robot no topic of a simulator may have an effect: a listener asks this first.
    """
    return not rospy.rostime.is_wallclock()


class PauseWatch:
    """Adds up how long the simulator has been paused. One per process, started by its first reader.

    :func:`merlin_ros.node.init_node` is that one: later the master may be lost.
    """

    def __init__(self) -> None:
        self._subscriber: Optional[rospy.Subscriber] = None
        self._lock = threading.Lock()  # guards all fields below
        self._started = False
        self._paused = False
        self._foreign = False  # whether ROS time is that of a simulator that says nothing of itself
        self._ahead = 0.0  # s
        self._looked = (0.0, 0.0)  # monotonic and ROS time at the last look, s
        self._total = 0.0

    def paused_time(self) -> float:
        """Seconds of monotonic time spent paused so far."""
        if not self._started:
            self._start()
        with self._lock:
            self._look()
            if self._paused and self._gone():  # what ended while it was paused does not stop the time forever
                self._paused = False
            return self._total

    def _start(self) -> None:
        if not (rospy.core.is_initialized() and rospy.rostime.is_rostime_initialized()) or lost.is_set():
            return  # the next reader tries again: without a master this would wait for its return
        with self._lock:
            if self._started:
                return
            self._started = True
            if not simulated():
                return
            self._looked, self._foreign = (time.monotonic(), rospy.get_time()), True
        # Not under the lock: where the topic is subscribed already, rospy calls `_update` within this.
        # Without a simulator there is no publisher here, and the time simply runs.
        self._subscriber = rospy.Subscriber(SIM_STATUS_TOPIC, SimStatus, self._update, queue_size=10)

    def _update(self, status: SimStatus) -> None:
        with self._lock:
            self._look()
            if status.paused and not self._paused:
                self._looked = time.monotonic(), rospy.get_time()
            self._paused, self._foreign = status.paused, False

    def _look(self) -> None:
        """Adds what was paused since the last look; called with the lock held."""
        if not (self._paused or self._foreign):
            return
        (before, ros_before), self._looked = self._looked, (time.monotonic(), rospy.get_time())
        passed, ran = self._looked[0] - before, max(0.0, self._looked[1] - ros_before)
        if self._foreign:
            self._ahead = min(AHEAD, self._ahead + ran)
            ran = max(SLOWEST * passed, min(passed, self._ahead))
            self._ahead = max(-AHEAD, self._ahead - ran)
        self._total += max(0.0, passed - ran)

    def _gone(self) -> bool:
        """Whether no connection to a simulator is open; rospy counts one that died for a while."""
        connections: Any = getattr(getattr(self._subscriber, "impl", None), "connections", None)
        return connections is not None and not any(
            getattr(connection, "socket", None) for connection in connections
        )


_pause_watch = PauseWatch()


def running_time() -> float:
    """The monotonic clock, s, which stands still while the simulator is paused."""
    return time.monotonic() - _pause_watch.paused_time()


_limits = Alarms("running limits", TickClock(running_time))


def call_when_passed(seconds: float, call: Callable[[], object]) -> Alarm:
    """Has a function called after some running time; see :meth:`merlin_ros.alarms.Alarms.call_later`.

    :param seconds: s of running time in which the process is not stalled.
    :param call: must not block.
    """
    return _limits.call_later(seconds, call)


def limit(seconds: float) -> Optional[float]:
    """What a parameter of which zero or less means "no limit" is to a :class:`Deadline`."""
    return seconds if seconds > 0 else None


class Deadline:
    """A point in running time.

    :param seconds: from now, s; zero or less: it has passed; None: never.
    """

    def __init__(self, seconds: Optional[float]) -> None:
        self.seconds = math.inf if seconds is None else max(0.0, seconds)
        self._end = running_time() + self.seconds

    def remaining(self) -> float:
        """Running time that is left, s; never negative, infinite when there is no deadline."""
        return max(0.0, self._end - running_time())

    @property
    def expired(self) -> bool:
        """Whether it has passed."""
        return self.remaining() <= 0.0

    def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
        """Waits, with the condition held, until the predicate is true, the deadline passes or ROS shuts down.

        :return: the last value of the predicate.
        """
        return self._wait(condition.wait, predicate)

    def wait_event(self, event: threading.Event) -> bool:
        """Waits until the event is set, the deadline passes or ROS shuts down.

        :return: whether the event is set.
        """
        return self._wait(event.wait, event.is_set)

    def _wait(self, sleep: Callable[[float], Any], predicate: Callable[[], bool]) -> bool:
        ticks = TickClock(running_time)
        while not predicate():
            left = self.remaining()
            if left < INSTANT or rospy.is_shutdown():
                return False
            # A bounded slice, because shutdown and the end of a pause do not notify.
            sleep(min(left, TICK) if left < math.inf else LONGEST_SLEEP)
            ticks.look()
            self._end += ticks.missed
        return True


class LookedAt(Deadline):
    """A deadline at which a thread looks now and then while it waits for other things.

    What the process misses comes on top, as the limits of this process count it.
    """

    def __init__(self, seconds: Optional[float]) -> None:
        super().__init__(seconds)
        limited = 0.0 < self.seconds < math.inf
        self._alarm = call_when_passed(self.seconds, lambda: None) if limited else None

    def remaining(self) -> float:
        """As of :class:`Deadline`; after a stall it is when to look again."""
        left = super().remaining()
        return TICK if not left and self._alarm is not None and self._alarm.waits else left
