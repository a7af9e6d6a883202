# SPDX-License-Identifier: Apache-2.0
"""Ends the service calls of a thread from another one: what waits for a hung node can be cancelled.

Without ROS. :class:`merlin_ros.service_proxy.ServiceProxy` obeys it.
"""

import threading
from contextlib import contextmanager
from typing import Any, Callable, Iterator, List, Optional

from merlin_ros.alarms import Alarm, call_later

Wake = Callable[[], None]


class CallScope:
    """The service calls that a thread makes inside of a ``with`` block.

    :param limit: for all of them together, s of wall time; None: each has only its own limit.
    """

    def __init__(self, limit: Optional[float] = None) -> None:
        self._limit = limit
        self._lock = threading.Lock()  # guards the fields below
        self._wake: Optional[Wake] = None
        self._alarms: List[Alarm] = []
        self._left = False
        self._outer: Optional[CallScope] = None
        self.ended = False
        """Whether its calls fail from now on."""
        self.gave_up = False
        """Whether a call has failed because of that."""

    def __enter__(self) -> "CallScope":
        self._outer = getattr(_current, "scope", None)
        _current.scope = self
        if self._limit is not None:
            self.end(self._limit)
        return self

    def __exit__(self, *_: Any) -> None:
        _current.scope = self._outer
        with self._lock:
            self._left = True
            alarms, self._alarms = self._alarms, []
        for alarm in alarms:
            alarm.cancel()

    def end(self, after: float = 0.0) -> None:
        """Ends the calls; from any thread, never blocks.

        :param after: s of wall time that a call under way still gets.
        """
        with self._lock:
            if not (self._left or self.ended):
                self._alarms.append(call_later(after, self._end))

    @contextmanager
    def calling(self, wake: Wake) -> Iterator["CallScope"]:
        """While a call is made.

        :param wake: ends the call's waits, from another thread; they ask :attr:`ended` before each.
        """
        with self._lock:
            self._wake = wake
        try:
            yield self
        except BaseException:
            self.gave_up = self.gave_up or self.ended
            raise
        finally:
            with self._lock:
                self._wake = None

    def _end(self) -> None:
        with self._lock:
            if self._left:
                return
            self.ended = True
            if self._wake is not None:
                self._wake()


class _Unlimited(CallScope):
    """The scope of threads that are in no other one."""

    @contextmanager
    def calling(self, wake: Wake) -> Iterator[CallScope]:
        yield self


_current = threading.local()
_unlimited = _Unlimited()


def current_scope() -> CallScope:
    """The scope that the calling thread is in; one that never ends when there is none."""
    scope: Optional[CallScope] = getattr(_current, "scope", None)
    return scope if scope is not None else _unlimited
