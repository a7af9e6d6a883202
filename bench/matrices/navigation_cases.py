# SPDX-License-Identifier: Apache-2.0
"""The situations that navigation is tried in: what changes in a world, what is driven, how it has to end."""

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Callable, List, Tuple

from merlin_reactive.navigation.navigator import DriveOutcome
from merlin_reactive.pose import Point, Pose
from merlin_reactive.seeded_random import draw
from merlin_sim.world.world_model import DoorEvent, MoveEvent, Person, Solid, World, WorldEvent

Leg = Tuple[str, Pose, Pose]


@dataclass(frozen=True)
class Case:
    """A kind of situation.

    :param change: makes the world of one trial from that of the file and a seed.
    :param legs: what is driven.
    :param expected: how it has to end.
    :param yaw_tolerance: rad that the final heading may be off; pi: any will do.
    """

    name: str
    change: Callable[[World, int], World]
    legs: Callable[[World], List[Leg]]
    expected: DriveOutcome = DriveOutcome.REACHED
    yaw_tolerance: float = math.pi


def cases(world: str) -> List[Case]:
    """The cases made for a world; for one that is not known here, the free ways."""
    free = Case("free", lambda world, seed: world, all_legs)
    return [free, *{"apartment": _apartment, "restaurant": _restaurant}.get(world, list)()]


def _apartment() -> List[Case]:
    return [
        Case("box in the way", _box, _between("dorm_room", "bathroom")),
        Case("furniture moved", _moved, _between("dorm_room", "kitchen")),
        Case("person stands in the way", _standing, _between("main_door", "bathroom")),
        Case("person crosses", _crossing, _between("dorm_room", "bathroom")),
        Case("person comes towards it", _oncoming, _between("bathroom", "main_door")),
        Case("door closes and opens again", _reopened, _between("dorm_room", "kitchen")),
        Case("door closes for good", _closed, _between("dorm_room", "kitchen"), DriveOutcome.NO_PLAN),
        Case("goal taken", _goal_taken, _between("dorm_room", "main_door"), DriveOutcome.NO_PLAN),
    ]


def _restaurant() -> List[Case]:
    served = Case("from the bar, with the final heading", lambda world, seed: world, _from_the_bar)
    return [
        dataclasses.replace(served, yaw_tolerance=0.1),
        Case("chair in the way", _chair, _between("bar", "table_2")),
        Case("guest stands in the way", _guest(4.0, 2.3), _between("entrance", "table_2")),
        Case("guest crosses", _walking_guest((3.4, 6.8), (3.4, 0.8), 0.8), _between("table_2", "bar")),
        Case(
            "guest comes towards it", _walking_guest((3.2, 4.3), (7.2, 4.9), 0.6), _between("bar", "table_2")
        ),
        Case("guest stands at the goal", _guest(2.5, 4.2), _between("bar", "table_2"), DriveOutcome.NO_PLAN),
    ]


def all_legs(world: World) -> List[Leg]:
    """All ways between the points of interest."""
    points = world.points_of_interest
    return [(f"{a} to {b}", points[a], points[b]) for a, b in itertools.permutations(points, 2)]


def _between(start: str, goal: str) -> Callable[[World], List[Leg]]:
    def legs(world: World) -> List[Leg]:
        points = world.points_of_interest
        return [(f"{start} to {goal}", points[start], points[goal])]

    return legs


def _jitter(seed: int, name: str, size: float) -> Tuple[float, float]:
    x, y = draw(seed, name, 0).uniform(-size, size, 2)
    return float(x), float(y)


def _box(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "box", 0.25)
    box = Solid("box", Pose(4.8 + dx, 3.75 + dy, dx), 0.5, size=(0.5, 0.4))
    return dataclasses.replace(world, unmapped=[box])


def _moved(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "table", 0.2)
    event = MoveEvent(2.0, "dining_table", Pose(4.5 + dx, 3.2 + dy, dy))
    return dataclasses.replace(world, events=[event])


def _standing(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "person", 0.3)
    return dataclasses.replace(world, people=[Person("ann", ((4.2 + dx, 3.6 + dy),))])


def _crossing(world: World, seed: int) -> World:
    dx, _ = _jitter(seed, "person", 0.5)
    path = ((4.8 + dx, 5.6), (4.8 + dx, 3.2))
    return dataclasses.replace(world, people=[Person("ann", path, speed=0.8, delay=seed % 5, pause=1.0)])


def _oncoming(world: World, seed: int) -> World:
    dx, _ = _jitter(seed, "person", 0.4)
    path = ((1.5, 2.6), (5.4 + dx, 3.7))
    return dataclasses.replace(world, people=[Person("ann", path, speed=0.6, delay=6 + seed % 5, pause=3.0)])


def _reopened(world: World, seed: int) -> World:
    events: List[WorldEvent] = [
        DoorEvent(3.0, "kitchen_door", False),
        DoorEvent(26.0 + seed % 5, "kitchen_door", True),
    ]
    return dataclasses.replace(world, events=events)


def _closed(world: World, seed: int) -> World:
    return dataclasses.replace(world, events=[DoorEvent(3.0 + seed % 5, "kitchen_door", False)])


def _goal_taken(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "goal", 0.1)
    goal = world.points_of_interest["main_door"]
    return dataclasses.replace(world, people=[Person("ann", ((goal.x + dx, goal.y + dy),))])


def _from_the_bar(world: World) -> List[Leg]:
    return [leg for leg in all_legs(world) if leg[0].startswith("bar to table")]


def _chair(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "chair", 0.3)
    event = MoveEvent(1.0, "chair_5", Pose(5.4 + dx, 4.6 + dy, dx))
    return dataclasses.replace(world, events=[event])


def _guest(x: float, y: float) -> Callable[[World, int], World]:
    def change(world: World, seed: int) -> World:
        dx, dy = _jitter(seed, "guest", 0.1)
        guest = Person("zoe", ((x + dx, y + dy),))
        return dataclasses.replace(world, people=[*world.people, guest])

    return change


def _walking_guest(start: Point, end: Point, speed: float) -> Callable[[World, int], World]:
    def change(world: World, seed: int) -> World:
        guest = Person("zoe", (start, end), speed=speed, delay=seed % 4, pause=2.0)
        return dataclasses.replace(world, people=[*world.people, guest])

    return change
