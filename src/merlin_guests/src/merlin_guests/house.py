# SPDX-License-Identifier: Apache-2.0
"""What stands where in the simulated restaurant, as its players know it."""

import itertools
import threading
from typing import Dict, List, Sequence

from merlin_guests.places import Places, Point
from merlin_guests.stage import Stage

BAR = "bar_counter"
EMPTIES = {
    "coffee": "cup",
    "water": "glass",
    "juice": "glass",
    "sandwich": "dirty_plate",
    "cake": "dirty_plate",
}


def tray_of(robot: str) -> str:
    """The simulator's name for the tray of a robot.

    :param robot: its namespace; empty: the only one.
    """
    return robot or "robot"


class House:
    """Puts dishes on tables, bar and tray, and remembers them.

    :param counter: middle of the bar's counter, m.
    """

    def __init__(self, stage: Stage, places: Places, counter: Point) -> None:
        self._stage = stage
        self._places = places
        self._counter = counter
        self._numbers = itertools.count(1)
        self._lock = threading.RLock()  # guards the fields below and the dishes in the world
        self._queue: List[str] = []
        self._dishes: Dict[str, Dict[str, str]] = {}  # where → name in the world → kind

    def join_queue(self, name: str) -> Point:
        """The place at the entrance where a guest waits."""
        with self._lock:
            if name not in self._queue:
                free = self._queue.index("") if "" in self._queue else len(self._queue)
                self._queue[free : free + 1] = [name]
            return self._places.queue[self._queue.index(name) % len(self._places.queue)]

    def leave_queue(self, name: str) -> None:
        """Makes that place free for others."""
        with self._lock:
            self._queue = ["" if other == name else other for other in self._queue]

    def counter_of(self, robot: str) -> str:
        """The place at the bar at which a robot stands."""
        return self._places.counter_near(self._stage.robot(robot))

    def on(self, where: str) -> List[str]:
        """Kinds of what stands somewhere: a table, a place at the bar or a tray."""
        with self._lock:
            return sorted(self._dishes.get(where, {}).values())

    def put(self, where: str, kinds: Sequence[str]) -> None:
        """Puts new dishes somewhere."""
        with self._lock:
            dishes = self._dishes.setdefault(where, {})
            for kind in kinds:
                name = f"{kind}_{next(self._numbers)}"
                on = BAR if where in self._places.counters else where
                self._stage.put_thing(name, kind, on, self._spot(where, len(dishes)))
                dishes[name] = kind

    def take(self, where: str) -> List[str]:
        """Takes all dishes away from somewhere; returns their kinds."""
        with self._lock:
            dishes = self._dishes.pop(where, {})
            for name in dishes:
                self._stage.remove(name)
            return sorted(dishes.values())

    def empty(self, table: str) -> None:
        """Replaces the dishes on a table by their empty plates and cups."""
        with self._lock:
            self.put(table, [EMPTIES.get(kind, kind) for kind in self.take(table)])

    def _spot(self, where: str, number: int) -> Point:
        if where in self._places.counters:
            return self._places.on_bar(self._counter, number, where)
        if where in self._places.tables:
            return self._places.plate(where, number)
        return (0.0, (0.08, -0.08)[number % 2])
