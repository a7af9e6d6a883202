# SPDX-License-Identifier: Apache-2.0
"""Whether this process has just hung: a cancel may wait behind the message that it reads first."""

import threading
import time
from typing import Callable, Optional

import rospy

from merlin_ros.alarms import every

HUNG = 1.0  # s of wall time without a beat after which the process counts as hung
PERIOD = 0.2  # s of wall time between two beats
SETTLE = 0.3  # s in which the threads of all connections have read what came meanwhile
LONGEST = 2.0  # s of wall time that a wait lasts at most, also when the beat never comes


class HangWatch:
    """The beat of a process; lets others wait until everything that came during a hang is read.

    A hung process (stopped, or its computer asleep) continues with a goal whose cancel waits in another
    connection. It would begin, and stop at once. A process in which nothing beats is not watched.

    :param clock: s of wall time.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._changed = threading.Condition()  # guards the fields below
        self._last: Optional[float] = None  # beat; None: nothing beats
        self._settled = 0.0

    def begin(self) -> None:
        """Beats from now on; without effect in a process in which it does."""
        with self._changed:
            if self._last is None:
                self._last = self._clock()
                every(PERIOD, self.beat)

    def beat(self) -> None:
        """The process lives; to be called more often than every `HUNG`."""
        with self._changed:
            now = self._clock()
            if self._last is not None and now - self._last > HUNG:
                self._settled = now + SETTLE
            self._last = now
            self._changed.notify_all()

    def unsettled(self) -> float:
        """For how long, s, one has to wait at least before what is read counts; 0: not at all."""
        with self._changed:
            now = self._clock()
            if self._last is not None and now - self._last > HUNG:
                return SETTLE  # the beat comes
            return max(0.0, self._settled - now)

    def silent(self, age: float, limit: float) -> bool:
        """Whether a peer is silent: not while what came during a hang of this process may be unread.

        :param age: of its last message, s.
        :param limit: from which it counts as silent, s.
        """
        return age >= limit and self.unsettled() == 0.0

    def wait_settled(self, unless: Callable[[], bool]) -> None:
        """Waits until what came during a hang is read.

        :param unless: ends the wait when it is true; looked at every `SETTLE` at least.
        """
        with self._changed:
            end = self._clock() + LONGEST
            left = self.unsettled()
            while left > 0.0 and self._clock() < end and not unless() and not rospy.is_shutdown():
                self._changed.wait(left)
                left = self.unsettled()


#: That of this process, which beats when an action server of it has begun.
hangs = HangWatch()
