# SPDX-License-Identifier: Apache-2.0
"""The time of a watcher, which does not count what the watcher itself missed, and calls that come by it.

A process that is stopped, or starved of its processor, sees everything else silent for just as long. So a
look at the clock counts one tick at the most, however long ago the last look was: a starved watcher must not
take another party for late or dead. Without ROS.

All calls that come later, once or again and again, are made by one thread of the process: its beats, its
looks at others, and its limits.
"""

import heapq
import itertools
import math
import threading
import time
from typing import Callable, List, Optional, Tuple

from merlin_ros.work.threads import log_failure, start_thread

TICK = 0.1  # s of wall time between two looks of a watcher
LONGEST_TICK = 0.2  # s that one look may count
INSTANT = 1e-6  # s that are not worth a wait: a sum of ticks is not exact
LEFT_OUT = object()  #: What a call returns that has done nothing this time.
_FEW = 64  # alarms below which those that were taken back are not worth a search


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
    """A call that is to come.

    :ivar period: s from one call to the next; None: it comes once.
    """

    def __init__(self, call: Callable[[], object], period: Optional[float] = None) -> None:
        self._call: Optional[Callable[[], object]] = call
        self.period = period
        self._fails = False

    @property
    def waits(self) -> bool:
        """Whether the call is still to come."""
        return self._call is not None

    def cancel(self) -> None:
        """Takes the call back; without effect when it was made, or is being made."""
        self._call = None

    def ring(self) -> None:
        """Makes the call unless it was taken back. What it raises is logged, the first time in a row."""
        call = self._call
        if self.period is None:
            self._call = None
        try:
            if call is not None and call() is not LEFT_OUT:
                self._fails = False
        except BaseException:  # the other alarms ring all the same
            if not self._fails:
                log_failure()
            self._fails = True


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

    def call_later(self, seconds: float, call: Callable[[], object]) -> Alarm:
        """Has a function called after some time, s of wall time in which the process is not stalled.

        :param call: must not block: others wait behind it, the leases of this process among them. What may
            block is put into a :class:`~merlin_ros.work.threads.CallQueue`, or gets a thread.
        """
        return self._put(Alarm(call), seconds)

    def every(self, period: float, call: Callable[[], object]) -> Alarm:
        """Has a function called again and again until the alarm is cancelled.

        Those of one period come together: each wakes the processor for all. So the first call comes after
        half a period to one and a half, and so does the next one after the end of a late one.

        :param period: s, as in :meth:`call_later`.
        :param call: likewise.
        """
        return self._put(Alarm(call, period), period)

    def _put(self, alarm: Alarm, seconds: float) -> Alarm:
        with self._changed:
            self._clock.look()
            if alarm.period is not None:
                when = alarm.period * (round(self._clock.now / alarm.period) + 1)
            else:  # NaN has no place in an order
                when = self._clock.now + (math.inf if math.isnan(seconds) else seconds)
            heapq.heappush(self._waiting, (when, next(self._numbers), alarm))
            if len(self._waiting) > self._many:
                self._forget_cancelled()
            if self._thread is None:
                self._thread = start_thread(self._name, self._work)
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
            alarm.ring()
            if alarm.period is not None and alarm.waits:
                self._put(alarm, alarm.period)

    def _next(self) -> Alarm:
        """Waits for the time of the next alarm; called with the lock held."""
        while True:
            while self._waiting and not self._waiting[0][2].waits:
                heapq.heappop(self._waiting)
            self._clock.look()
            left = self._waiting[0][0] - self._clock.now if self._waiting else math.inf
            if left <= 0.0:
                return heapq.heappop(self._waiting)[2]
            left = min(left, LONGEST_TICK)
            self._sleeps_until = self._clock.now + left if self._waiting else math.inf
            self._changed.wait(left if self._waiting else None)
            self._sleeps_until = -1.0


_of_process = Alarms("timer")
call_later = _of_process.call_later
every = _of_process.every
