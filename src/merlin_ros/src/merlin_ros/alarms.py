"""The time of a watcher, which does not count what the watcher itself missed, and calls that come by it.

A process that is stopped, or starved of its processor, sees everything else silent for just as long. So a
look at the clock counts one tick at the most, however long ago the last look was: a starved watcher must not
take another party for late or dead. Without ROS.

All calls that come later are made by one thread of the process. `threading.Timer` starts a thread for each:
too much for the limit of a service call, which few reach.
"""

import heapq
import itertools
import logging
import math
import threading
import time
from typing import Callable, List, Optional, Tuple

TICK = 0.1  # s of wall time between two looks of a watcher
LONGEST_TICK = 0.2  # s that one look may count
INSTANT = 1e-6  # s that are not worth a wait: a sum of ticks is not exact
_FEW = 64  # alarms below which those that were taken back are not worth a search

_log = logging.getLogger(__name__)


class TickClock:
    """Counts the time of a watcher that looks every :data:`TICK`. Not thread-safe.

    :param clock: s, never set back.
    :param longest: s that one look may count; longer than the time between two looks of the watcher.
    :ivar now: s counted so far.
    :ivar missed: s that passed before the last look and do not count.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, longest: float = LONGEST_TICK) -> None:
        self._clock = clock
        self._longest = longest
        self._last = clock()
        self.now = 0.0
        self.missed = 0.0

    def look(self) -> float:
        """Looks at the clock; returns the s since the last look that count."""
        seen = self._clock()
        elapsed, self._last = max(0.0, seen - self._last), seen
        counted = min(elapsed, self._longest)
        self.missed = elapsed - counted
        self.now += counted
        return counted


def wait_ticks(
    attempt: Callable[[float], bool], seconds: float, clock: Callable[[], float] = time.monotonic
) -> bool:
    """Waits for at most some seconds of the caller's own time.

    :param attempt: waits for at most so many s as it is given, and says whether it has come:
        ``Event.wait``, for example.
    :param seconds: zero or less: one attempt, which does not wait.
    :return: whether it has come.
    """
    ticks = TickClock(clock)
    while not attempt(max(0.0, min(seconds - ticks.now, TICK))):
        ticks.look()
        if seconds - ticks.now < INSTANT:
            return False
    return True


class Alarm:
    """A call that is to come."""

    def __init__(self, call: Callable[[], None]) -> None:
        self._call: Optional[Callable[[], None]] = call

    @property
    def waits(self) -> bool:
        """Whether the call is still to come."""
        return self._call is not None

    def cancel(self) -> None:
        """Takes the call back; without effect when it was made, or is being made."""
        self._call = None

    def ring(self) -> None:
        """Makes the call unless it was taken back."""
        call, self._call = self._call, None
        if call is not None:
            call()


class Alarms:
    """Alarms of one thread, which is started with the first of them.

    :param name: of the thread.
    :param clock: of the thread; default: one of wall time.
    """

    def __init__(self, name: str, clock: Optional[TickClock] = None) -> None:
        self._name = name
        self._changed = threading.Condition()  # guards the fields below
        self._numbers = itertools.count()
        self._waiting: List[Tuple[float, int, Alarm]] = []
        self._clock = clock or TickClock()  # stands still while nothing waits
        self._sleeps_until = -1.0  # by this clock, s; before it the thread looks by itself
        self._many = _FEW
        self._thread: Optional[threading.Thread] = None

    def call_later(self, seconds: float, call: Callable[[], None]) -> Alarm:
        """Has a function called after some time, s of wall time in which the process is not stalled.

        :param call: must not block: others wait behind it.
        """
        alarm = Alarm(call)
        with self._changed:
            self._clock.look()
            # NaN has no place in an order.
            when = self._clock.now + (math.inf if math.isnan(seconds) else seconds)
            heapq.heappush(self._waiting, (when, next(self._numbers), alarm))
            if len(self._waiting) > self._many:
                self._forget_cancelled()
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
                self._thread.start()
            elif when < self._sleeps_until:
                self._changed.notify()
        return alarm

    def _forget_cancelled(self) -> None:
        self._waiting = [entry for entry in self._waiting if entry[2].waits]
        heapq.heapify(self._waiting)
        self._many = max(_FEW, 2 * len(self._waiting))

    def _work(self) -> None:
        while True:
            with self._changed:
                alarm = self._next()
            try:
                alarm.ring()
            except Exception:  # the other alarms ring all the same
                _log.exception("an alarm of %s failed", self._name)

    def _next(self) -> Alarm:
        """Waits for the time of the next alarm; called with the lock held."""
        while True:
            while self._waiting and not self._waiting[0][2].waits:
                heapq.heappop(self._waiting)
            self._clock.look()
            left = self._waiting[0][0] - self._clock.now if self._waiting else math.inf
            if left <= 0.0:
                return heapq.heappop(self._waiting)[2]
            self._sleeps_until = self._clock.now + min(left, TICK) if self._waiting else math.inf
            self._changed.wait(min(left, TICK) if self._waiting else None)
            self._sleeps_until = -1.0


_of_process = Alarms("limits")


def call_later(seconds: float, call: Callable[[], None]) -> Alarm:
    """Has a function called after some time; see :meth:`Alarms.call_later`."""
    return _of_process.call_later(seconds, call)
