"""Calls functions later, all from one thread of the process. Without ROS.

`threading.Timer` starts a thread for each: too much for the limit of a service call, which few reach.
"""

import heapq
import itertools
import logging
import math
import threading
import time
from typing import Callable, List, Optional, Tuple

_LONGEST = 3600.0  # s that the thread sleeps at once: Python cannot wait for more than some hundred years
_FEW = 64  # alarms below which those that were taken back are not worth a search

_log = logging.getLogger(__name__)


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
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._changed = threading.Condition()  # guards the fields below
        self._numbers = itertools.count()
        self._waiting: List[Tuple[float, int, Alarm]] = []
        self._sleeps_until = -1.0  # monotonic, s; before it the thread looks by itself
        self._many = _FEW
        self._thread: Optional[threading.Thread] = None

    def call_later(self, seconds: float, call: Callable[[], None]) -> Alarm:
        """Has a function called after some time, s of wall time.

        :param call: must not block: others wait behind it.
        """
        alarm = Alarm(call)
        # NaN has no place in an order.
        when = time.monotonic() + (math.inf if math.isnan(seconds) else seconds)
        with self._changed:
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
            left = self._waiting[0][0] - time.monotonic() if self._waiting else None
            if left is not None and left <= 0.0:
                return heapq.heappop(self._waiting)[2]
            self._sleeps_until = self._waiting[0][0] if self._waiting else float("inf")
            self._changed.wait(None if left is None else min(left, _LONGEST))
            self._sleeps_until = -1.0


_of_process = Alarms("limits")


def call_later(seconds: float, call: Callable[[], None]) -> Alarm:
    """Has a function called after some time; see :meth:`Alarms.call_later`."""
    return _of_process.call_later(seconds, call)
