# SPDX-License-Identifier: Apache-2.0
"""What waits for a robot's deciding thread: events in their order, and changes of keys in batches."""

import threading
import time
from collections import deque
from typing import Deque, List, Tuple, Union

from merlin_fleet.core import events as ev
from merlin_fleet.core.store import Change

#: Events about the connection: the changes before them come before them.
CONNECTION = (ev.Connected, ev.Resumed, ev.Disconnected)
#: After a decision changes wait for so many times what it took: others need the processor, too.
REST = 4.0
LONGEST = 1.0  # s for which they wait in any case


class EventInbox:
    """Events for one thread, from any. Changes that are not urgent wait, and come as one event.

    In a large fleet nearly all changes are about other robots; a decision after each one would cost more
    than all the rest. Other events may overtake changes: an answer of the hub says the same as its change.

    :param gather: s for which changes wait at most, where decisions are quick.
    """

    def __init__(self, gather: float) -> None:
        self._least = self._gather = gather
        self._changed = threading.Condition()  # guards the fields below
        self._events: Deque[Union[ev.Event, str]] = deque()
        self._batch: List[Change] = []
        self._due = 0.0

    def put(self, event: Union[ev.Event, str]) -> None:
        """Queues an event for the thread that decides; one of the connection is not overtaken by changes."""
        with self._changed:
            if isinstance(event, CONNECTION):
                self._close()
            self._events.append(event)
            self._changed.notify()

    def put_changes(self, changes: Tuple[Change, ...], urgent: bool) -> None:
        """Queues changes of keys; those of a short time are delivered together.

        :param urgent: whether all waiting changes are delivered at once.
        """
        with self._changed:
            if not self._batch:
                self._due = time.monotonic() + self._gather
                self._changed.notify()
            self._batch += changes
            if urgent:
                self._close()
                self._changed.notify()

    def took(self, seconds: float) -> None:
        """Notes what a decision took, s: the slower they are, the more changes are looked at together."""
        with self._changed:
            self._gather = max(self._least, min(LONGEST, REST * seconds))

    def next(self, wait: float) -> Union[ev.Event, str]:
        """The next event; None: none came in time."""
        end = time.monotonic() + wait
        with self._changed:
            while not self._events:
                now = time.monotonic()
                if self._batch and now >= self._due:
                    self._close()
                elif now >= end:
                    return None
                else:
                    self._changed.wait((min(end, self._due) if self._batch else end) - now)
            return self._events.popleft()

    def _close(self) -> None:
        if self._batch:
            self._events.append(ev.Changed(tuple(self._batch)))
            self._batch = []
