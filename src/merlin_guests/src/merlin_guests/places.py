# SPDX-License-Identifier: Apache-2.0
"""Where people stand, sit and walk in the simulated restaurant, from its world file."""

import contextlib
import math
from typing import List, Sequence, Tuple

import numpy as np

from merlin_reactive.navigation.path_planner import NoPath, PathPlanner
from merlin_reactive.pose import Point, Pose
from merlin_sim.people.walkers import ROOM as FROM_ROBOT
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_model import World
from merlin_sim.world.world_places import ROBOT_RADIUS

ENTRANCE_DOOR = "entrance_door"
BAR = "bar"  # point of interest; further ones are bar_2, bar_3
BODY, ROOM = 0.25, 0.05  # m, radius of a walking person, and what it keeps free besides
SEAT = 0.85  # m from the middle of a table, on the side away from its point of interest
DOOR_STEP = 0.45  # m from the door's middle to where people come in
WAITING = 1.5  # m ahead of the entrance's point of interest
# m ahead and to the left of it: the waiting places.
QUEUE = ((WAITING, 0.0), (1.75, -0.5), (1.75, 0.5), (1.15, 0.62))
THING = 0.25  # m, radius of what people find in their way
TABLE_AHEAD = 0.9  # m ahead of a table's point of interest


class Places:
    """Places and ways of people.

    :param world: of the restaurant, with tables' points of interest and a door named ``ENTRANCE_DOOR``.
    """

    def __init__(self, world: World) -> None:
        self._pois = world.points_of_interest
        self.tables = {name for name in self._pois if name.startswith("table_")}
        self.counters = sorted(name for name in self._pois if name == BAR or name.startswith(f"{BAR}_"))
        self._planner = PathPlanner(map_of(world), BODY, ROOM)
        door = next(door for door in world.doors if door.name == ENTRANCE_DOOR)
        middle = ((door.start[0] + door.end[0]) / 2, (door.start[1] + door.end[1]) / 2)
        inside = self._ahead("entrance", WAITING)
        self.queue = [self._ahead("entrance", ahead, aside) for ahead, aside in QUEUE]
        along = (door.end[0] - door.start[0], door.end[1] - door.start[1])
        length = math.hypot(*along)
        normal = (-along[1] / length, along[0] / length)
        side = 1.0 if (inside[0] - middle[0]) * normal[0] + (inside[1] - middle[1]) * normal[1] > 0 else -1.0
        self.door = (middle[0] + side * DOOR_STEP * normal[0], middle[1] + side * DOOR_STEP * normal[1])

    def seat(self, table: str) -> Tuple[Point, float]:
        """Where a guest sits, and the yaw (rad) in which the guest looks at the table."""
        pose = self._pois[table]
        return self._ahead(table, TABLE_AHEAD + SEAT), (pose.yaw + math.pi) % (2 * math.pi)

    def plate(self, table: str, number: int) -> Point:
        """Where the guest's dishes stand: m from the middle of the table."""
        turn = Pose(0.0, 0.0, self._pois[table].yaw)
        return turn.compose(Pose(0.12, (0.14, -0.14)[number % 2])).point

    def way(self, start: Point, goal: Point) -> List[Point]:
        """A way round the furniture; straight when every way is blocked (people squeeze through)."""
        try:
            return self._planner.plan(start, goal)
        except NoPath:
            return [goal]

    def way_round(
        self, robots: Sequence[Point], things: Sequence[Point], start: Point, goal: Point
    ) -> List[Point]:
        """A way that also keeps clear of robots and of things that are not on the map.

        Without such a way, they are ignored.
        """
        outlines = [_circle(robot, ROBOT_RADIUS + FROM_ROBOT) for robot in robots]
        outlines += [_circle(thing, THING) for thing in things]
        with contextlib.suppress(NoPath):
            return self._planner.plan(start, goal, np.concatenate(outlines))
        return self.way(start, goal)

    def on_the_way(self, goal: str, start: str, distance: float) -> Point:
        """A place on the robot's way between two points of interest, where it leaves both free.

        :param distance: m before the end of the way; a short way is met in its middle.
        """
        way = self._planner.plan(self._pois[start].point, self._pois[goal].point)
        length = sum(math.dist(a, b) for a, b in zip(way, way[1:]))
        return shortened(way, min(distance, length / 2))[-1]

    def way_near(self, start: Point, goal: Point, distance: float) -> List[Point]:
        """A way that ends before its goal.

        :param distance: m that are left to the goal.
        """
        return shortened([start, *self.way(start, goal)], distance)[1:] or [start]

    def counter_near(self, robot: Point) -> str:
        """The place at the bar at which a robot stands: the nearest point of interest of those there."""
        return min(self.counters, key=lambda name: math.dist(robot, self._pois[name].point))

    def on_bar(self, counter: Point, number: int, place: str = BAR) -> Point:
        """Where an item of an order is put on the bar: m from the middle of the counter.

        :param place: the point of interest before which it is put.
        """
        spot = self._ahead(place, 0.68)
        return spot[0] - counter[0], spot[1] - counter[1] + (0.16, -0.16, 0.0)[number % 3]

    def _ahead(self, poi: str, distance: float, aside: float = 0.0) -> Point:
        return self._pois[poi].compose(Pose(distance, aside)).point


def _circle(middle: Point, radius: float) -> np.ndarray:
    around = np.linspace(0.0, 2 * math.pi, 60)
    return np.asarray(middle) + radius * np.stack([np.cos(around), np.sin(around)], axis=1)


def shortened(way: Sequence[Point], distance: float) -> List[Point]:
    """A way without its last metres; only its start when it is no longer than these."""
    kept = list(way)
    left = distance
    while len(kept) > 1:
        end, begin = kept[-1], kept[-2]
        length = math.dist(begin, end)
        if length > left:
            share = left / length
            kept[-1] = (end[0] + share * (begin[0] - end[0]), end[1] + share * (begin[1] - end[1]))
            break
        left -= length
        kept.pop()
    return kept
