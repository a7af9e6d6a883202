"""The two times of a bag: ROS time, at which its messages lie, and the time of the clock on the wall."""

from typing import Sequence, Tuple

import numpy

SLOWEST = 0.01  # factor of a simulation; below it is a pause, in which ROS time does not continue


class BagClock:
    """Puts ROS time into s since 1970, and back.

    On a robot they are the same. The messages of a simulation lie at its own time, which begins at 0 and
    is faster or slower.

    :param begin: s of ROS time.
    :param end: s of ROS time.
    :param factors: of a simulation: s of ROS time, and how fast it was up to then; none: a robot.
    :param written: s since 1970 when the bag of a simulation was ended.
    """

    def __init__(
        self, begin: float, end: float, factors: Sequence[Tuple[float, float]] = (), written: float = 0.0
    ) -> None:
        if not factors:
            self._times = self._walls = numpy.array([begin, end])
            return
        inside = [(at, factor) for at, factor in factors if begin < at < end]
        times = numpy.array([begin, *(at for at, _ in inside), end])
        speeds = numpy.array([*(factor for _, factor in inside), factors[-1][1]])
        passed = numpy.diff(times) / numpy.maximum(speeds, SLOWEST)
        walls = numpy.concatenate(([0.0], numpy.cumsum(passed)))
        self._times, self._walls = times, walls + (written - walls[-1])

    @property
    def begin(self) -> float:
        """Wall time of the first message, s since 1970."""
        return float(self._walls[0])

    @property
    def end(self) -> float:
        """Wall time of the last message, s since 1970."""
        return float(self._walls[-1])

    def wall(self, at: float) -> float:
        """s since 1970 at a ROS time."""
        return float(numpy.interp(at, self._times, self._walls))

    def time(self, wall: float) -> float:
        """ROS time, s."""
        return float(numpy.interp(wall, self._walls, self._times))
