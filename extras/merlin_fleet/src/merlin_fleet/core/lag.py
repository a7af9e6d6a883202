# SPDX-License-Identifier: Apache-2.0
"""How far a robot is behind the store's changes: measured by its own writes, and what follows from it.

The answer to a transaction and its change leave the store together. So the time between them is what the
robot itself needs for the changes before it, whatever the network needs; what it decides meanwhile is old.
"""

from collections import deque
from typing import Deque, Tuple

TOLERATED = 0.2  # s that have no consequence
#: For so many times what is more, it writes nothing that would put itself and others further behind.
PATIENCE = 10.0
LONGEST = 30.0  # s for which it does so


class Lag:
    """The lag of one robot. Times in s, by the clock of `Agent.handle`."""

    def __init__(self) -> None:
        self._unseen: Deque[Tuple[int, float]] = deque()
        self._last = 0.0
        self.until = 0.0
        """Until then the robot writes nothing that all robots have to read."""

    def wrote(self, revision: int, seen: int, now: float) -> None:
        """A transaction was answered.

        :param revision: at which it was done.
        :param seen: the last revision that the robot has seen.
        """
        if revision > seen:
            self._unseen.append((revision, now))

    def saw(self, revision: int, now: float) -> None:
        """All changes up to a revision were seen."""
        while self._unseen and self._unseen[0][0] <= revision:
            self._last = now - self._unseen.popleft()[1]
            self.until = now + min(LONGEST, PATIENCE * (self._last - TOLERATED))

    def forget(self) -> None:
        """Everything was read anew."""
        self._unseen.clear()

    def blind(self, now: float) -> bool:
        """Whether there is something of its own that the robot has not seen yet.

        Not forever: an answer may be of a store that was replaced since.
        """
        while self._unseen and now >= self._unseen[0][1] + LONGEST:
            self._unseen.popleft()
        return bool(self._unseen)

    def seconds(self, now: float) -> float:
        """Its lag, now or a moment ago, s; 0: too small to matter."""
        last = self._last if now < self.until else 0.0
        first = now - self._unseen[0][1] if self._unseen else 0.0
        return max(last, first if first > TOLERATED else 0.0)
