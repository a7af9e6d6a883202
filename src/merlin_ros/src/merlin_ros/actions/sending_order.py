# SPDX-License-Identifier: Apache-2.0
"""In which order stamped messages were sent, though the clocks that stamp them may be set. Without ROS."""

from typing import Optional


class SendingOrder:
    """Places stamps on a line of its own, which follows ROS time and never goes back. Not thread-safe.

    All times are ns.
    """

    def __init__(self) -> None:
        self._now: Optional[int] = None  # ROS time at the last look
        self._line = 0

    def look(self, now: int) -> int:
        """ROS time is `now`; to be called before each stamp. Returns what has passed since the last look."""
        if self._now is None:
            self._now = self._line = now
        passed = now - self._now if now >= self._now else 1  # what comes after a step back comes later
        self._now, self._line = now, self._line + passed
        return passed

    def place(self, stamp: int) -> int:
        """Where a stamp of ROS time is on the line; beyond its end when it is ahead of the clock."""
        return stamp if self._now is None else self._line + stamp - self._now

    def sent(self, stamp: int) -> int:
        """Where something was sent that is there: now at the latest, whatever its stamp."""
        return stamp if self._now is None else min(self.place(stamp), self._line)
