# SPDX-License-Identifier: Apache-2.0
"""ROS time as it passes, though its clock may be set back, and as a clock shows it. Without ROS."""

import time

CALENDAR = 1e8  # s; less is the time of a simulator, which began at zero
LAST = 2.0**32 - 1.0  # s; ROS has no later time


def clock_text(at: float) -> str:
    """``123.4 s`` in a simulation, else the time of the day."""
    return f"{at:.1f} s" if at < CALENDAR else time.strftime("%H:%M:%S", time.localtime(min(at, LAST)))


class PassedTime:
    """A line of time that follows a clock and never goes back: what has passed has passed. Not thread-safe.

    Durations are differences on the line. It is ROS time itself until the clock is set back.

    :param now: ROS time, s.
    :ivar now: ROS time at the last look, s.
    """

    def __init__(self, now: float) -> None:
        self.now = now
        self._moved = 0.0  # s by which the line is ahead of the clock

    @property
    def line(self) -> float:
        """How far time had passed at the last look, s."""
        return self.now + self._moved

    def look(self, now: float) -> float:
        """ROS time is `now`; returns the line."""
        if now < self.now:
            self.set(now)
        self.now = now
        return self.line

    def set(self, now: float) -> None:
        """The clock was set to `now`, or begins there: nothing has passed."""
        self._moved += self.now - now
        self.now = now

    def at(self, time: float) -> float:
        """Where a ROS time is on the line, s."""
        return time + self._moved

    def clock(self, line: float) -> float:
        """The ROS time at a place on the line, s."""
        return line - self._moved
