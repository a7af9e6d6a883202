# SPDX-License-Identifier: Apache-2.0
"""Where the robot really was, for the metrics: positions over time, distances, standstills."""

import bisect
import math
import threading
from array import array
from typing import List, NamedTuple, Optional

#: Speed below which the robot counts as standing, m/s; it may turn on the spot for its next task by then.
STANDSTILL = 0.01


class Sample(NamedTuple):
    """The true state of the robot at one moment: s of ROS time; frame map, m and rad; m/s, rad/s."""

    time: float
    x: float
    y: float
    yaw: float
    speed: float
    turn_rate: float

    @property
    def standing(self) -> bool:
        """Whether the robot does not drive."""
        return abs(self.speed) < STANDSTILL


class Trajectory:
    """The samples of one run, in the order of time; one thread adds, any may read.

    A run of hours has hundreds of thousands: they are kept as numbers, which takes a fifth of the objects.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards the fields below
        self._columns = [array("d") for _ in Sample._fields]
        self._times = self._columns[0]
        self._ways = array("d")  # m driven up to each sample

    def add(self, sample: Sample) -> None:
        """Adds a sample; one that is not newer than the last (time jumped back) is left out."""
        with self._changed:
            if self._times and sample.time <= self._times[-1]:
                return
            way = 0.0
            if self._times:
                last = self._sample(-1)
                way = self._ways[-1] + math.hypot(sample.x - last.x, sample.y - last.y)
            for column, value in zip(self._columns, sample):
                column.append(value)
            self._ways.append(way)
            self._changed.notify_all()

    def samples(self, start: float) -> List[Sample]:
        """The samples at and after a time."""
        with self._changed:
            return [self._sample(index) for index in self._since(start)]

    def last(self) -> Optional[Sample]:
        """The newest sample; None: none yet."""
        with self._changed:
            return self._sample(-1) if self._times else None

    def wait_until(self, time: float, timeout: float) -> bool:
        """Waits for a sample at or after a time.

        :param time: s of ROS time.
        :param timeout: wall seconds.
        :return: False when none came.
        """
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._times) and self._times[-1] >= time, timeout)

    def distance(self, start: float, end: float) -> float:
        """Metres driven between two times, interpolated between samples."""
        return self._way(end) - self._way(start)

    def standstill_after(self, time: float) -> Optional[float]:
        """The first moment at or after a time in which the robot stands (s); None: it never did."""
        with self._changed:
            indices = self._since(time)
            return next((self._times[index] for index in indices if self._sample(index).standing), None)

    def _since(self, time: float) -> range:
        return range(bisect.bisect_left(self._times, time), len(self._times))

    def _sample(self, index: int) -> Sample:
        return Sample(*(column[index] for column in self._columns))

    def _way(self, time: float) -> float:
        with self._changed:
            if not self._times:
                return 0.0
            index = bisect.bisect_right(self._times, time)
            if index == 0:
                return self._ways[0]
            if index == len(self._times):
                return self._ways[-1]
            share = (time - self._times[index - 1]) / (self._times[index] - self._times[index - 1])
            return self._ways[index - 1] + share * (self._ways[index] - self._ways[index - 1])
