# SPDX-License-Identifier: Apache-2.0
"""A guest follows the robot along its trail, however long the evening is, and past tables near it."""

import contextlib
import math
from typing import Callable, List, Optional, Sequence

import pytest
from merlin_msgs.msg import SimPerson

from merlin_guests import guest as guest_module
from merlin_guests.guest import KEPT, LOOK, Guest
from merlin_guests.places import Point
from merlin_guests.schedule import make_schedule
from merlin_guests.stage import AHEAD, PlayError, Stage

PACE = 0.5  # m/s
STEP = 0.15  # m between the places of the trail
Free = Callable[[Point], bool]


class Room(Stage):
    """The stage of one guest and one robot, which drives along a trail and then offers a seat.

    :param trail: of the robot, from the evening's beginning to the table.
    :param joined: number of the place where the robot is when the guest begins to follow.
    :param free: whether a person may stand at a place.
    """

    def __init__(self, trail: List[Point], joined: int, free: Free = lambda place: True) -> None:
        self._drive, self._at, self._free = trail, float(joined), free
        self._changed = contextlib.nullcontext()
        self._time = 0.0
        self._way: List[Point] = []
        self.guest: Point = (trail[joined][0] - KEPT, trail[joined][1])
        self.walked = [self.guest]
        self.refused = 0

    def trail(self, since: int, name: str = "") -> List[Point]:
        return self._drive[since : int(self._at) + 1]

    def trail_length(self, name: str = "") -> int:
        return int(self._at) + 1

    def now(self) -> float:
        return self._time

    def robot(self, name: str = "") -> Point:
        return self._drive[int(self._at)]

    def robots(self) -> List[Point]:
        return [self.robot()]

    def position(self, name: str) -> Point:
        return self.guest

    def walk(self, name: str, path: Sequence[Point], speed: float = 0.0, **_: object) -> int:
        if not self._free(path[-1]):
            self.refused += 1
            raise PlayError("a table is there")
        self._way = list(path)
        return 1

    def hear(self, name: str, text: object, seconds: float, by: Optional[str] = None) -> str:
        """Time passes: both move. A robot that has arrived waits for the guest, and then offers a seat."""
        self._time += seconds
        last = len(self._drive) - 1
        arrived = self._at >= last
        if math.dist(self.guest, self.robot()) < 1.9:
            self._at = min(float(last), self._at + PACE * seconds / STEP)
        self._go(PACE * seconds)
        near = math.dist(self.guest, self.robot()) < 1.4
        return "this is table 1. please take a seat." if arrived and near else ""

    def _go(self, distance: float) -> None:
        while self._way and distance > 0.0:
            ahead = math.dist(self.guest, self._way[0])
            share = min(1.0, 0.02 / ahead) if ahead else 1.0
            there = tuple(a + share * (b - a) for a, b in zip(self.guest, self._way[0]))
            if not self._free(there) and self._free(self.guest):
                return
            self.guest = there
            self.walked.append(there)
            distance -= share * ahead
            if share == 1.0:
                self._way.pop(0)


class Round:
    """Ways of people that keep clear of the table at (5, -0.2): round it on the left."""

    def __init__(self) -> None:
        self.asked = 0

    def way_near(self, start: Point, goal: Point, distance: float) -> List[Point]:
        self.asked += 1
        corner = [(5.0, 0.5)] if start[0] < 5.0 < goal[0] else []
        last = corner[-1] if corner else start
        length = math.dist(last, goal)
        share = max(0.0, 1.0 - distance / length)
        return [*corner, tuple(a + share * (b - a) for a, b in zip(last, goal))]


def follow(room: Room, places: Optional[Round] = None) -> bool:
    return Guest(make_schedule(1, 1, 0)[0], room, places or Round(), None)._follow()


def line(length: float) -> List[Point]:
    return [(STEP * number, 0.0) for number in range(round(length / STEP) + 1)]


def corner(length: float) -> List[Point]:
    """A trail with a corner, which a person on the nearest way cuts, and a follower does not."""
    there = line(length)
    return [*there, *((there[-1][0], STEP * number) for number in range(1, 20))]


@pytest.mark.parametrize("before", (3.0, 58.0, 61.0, 500.0))
def test_who_follows_walks_where_the_robot_went_however_far_it_has_driven_that_evening(before: float) -> None:
    joined = round(before / STEP)
    trail = corner(before + 3.0)
    room = Room(trail, joined)
    assert follow(room)
    assert math.dist(room.guest, room.robot()) < 1.4
    near = trail[joined - 10 :]  # others are farther away than the guest ever gets from these
    off = max(min(math.dist(place, step) for step in near) for place in room.walked)
    assert off < STEP, f"the guest was {off:.2f} m off the trail"


def test_where_the_robot_stands_too_near_a_table_the_guest_comes_as_near_as_there_is_room() -> None:
    room = Room(line(3.75), 0, lambda place: place[0] < 2.5)
    assert follow(room)
    assert room.refused
    assert room.guest[0] > 2.5 - STEP


def test_where_the_robot_passed_a_table_closer_than_people_can_the_guest_goes_round_it() -> None:
    table = (5.0, -0.2)
    room, places = Room(line(9.0), 10, lambda place: math.dist(place, table) > 0.25), Round()
    assert follow(room, places)
    assert places.asked
    assert math.dist(room.guest, room.robot()) < 1.4
    assert min(math.dist(place, table) for place in room.walked) > 0.24


def test_who_follows_gives_up_when_the_robot_does_not_go_on() -> None:
    room = Room(line(2.0), 5)
    room.hear = lambda *_, **__: setattr(room, "_time", room._time + LOOK) or ""
    assert not follow(room)


def test_who_is_told_that_the_robot_has_lost_them_gives_up_though_it_drives_on() -> None:
    room, hear = Room(line(30.0), 5), Room.hear

    def reported(name: str, texts: Sequence[str], seconds: float, by: str) -> str:
        hear(room, name, texts, seconds)
        sorry = "i am sorry, i have lost you. please wait at the entrance."
        return sorry if room.now() > 5.0 and any(text in sorry for text in texts) else ""

    room.hear = reported
    assert not follow(room)
    assert room.now() < 6.0


def test_who_follows_gives_up_when_the_robot_drives_away() -> None:
    room = Room(line(30.0), 5, lambda place: False)  # no way after it
    room.hear = lambda *_, **__: (
        setattr(room, "_time", room._time + LOOK) or setattr(room, "_at", room._at + 2) or ""
    )
    assert not follow(room)
    assert room._at < len(room._drive) - 1


def test_who_leaves_walks_round_a_robot_that_comes_into_the_way_and_round_a_chair() -> None:
    class Hall(Room):
        """Here a walk ends when it is asked for, unless the robot stands in its way."""

        removed = False

        def walk(self, name: str, path: Sequence[Point], *_: object, **__: object) -> int:
            self._way = list(path)
            self._at = 5.0  # the robot drives off while the guest stands up
            return 1

        def in_the_way(self, name: str) -> Optional[Point]:
            return next((thing for thing in (self.robot(), chair) if thing in self._way), None)

        def arrived(self, name: str, walk: int, limit: float = 120.0) -> bool:
            self._time += limit
            return self.in_the_way(name) is None

        def remove(self, name: str) -> None:
            self.removed = True

        def answer(self, *_: object) -> None:
            pass

        publish = answer

    class Ways:
        door = (9.0, 0.0)

        def way_round(
            self, robots: Sequence[Point], things: Sequence[Point], start: Point, goal: Point
        ) -> List[Point]:
            through = [] if room._drive[5] in robots else [room._drive[5]]
            return [*through, *(set() if chair in things else {chair}), goal]

    chair = (3.0, 3.0)
    room = Hall(line(2.0), 0)
    house = type("House", (), {"leave_queue": lambda self, name: None})()
    Guest(make_schedule(1, 1, 0)[0], room, Ways(), house)._leave("content")
    assert room.removed and room.now() < 15.0


def test_what_holds_somebody_up_stands_where_they_look() -> None:
    room = Room(line(1.0), 0)
    room._people = {"ann": SimPerson(name="ann", x=1.0, y=2.0, yaw=math.pi / 2, waits_for="chair_5")}
    thing = room.in_the_way("ann")
    assert thing is not None and math.dist(thing, (1.0, 2.0 + AHEAD)) < 1e-6
    room._people["ann"].waits_for = ""
    assert room.in_the_way("ann") is None


def test_a_guest_who_cannot_come_in_says_so_and_comes_later(monkeypatch: pytest.MonkeyPatch) -> None:
    said: List[str] = []
    monkeypatch.setattr(guest_module.rospy, "logwarn_throttle", lambda period, text: said.append(text))

    class Door(Room):
        tries = 0

        def put_person(self, name: str, at: Point, *_: object) -> None:
            self.tries += 1
            if self.tries < 3:
                raise PlayError(f"{name}: ben is there")

        def wait(self, seconds: float) -> None:
            self._time += seconds

        def publish(self, *_: object) -> None:
            pass

    room = Door(line(1.0), 0)
    plan = make_schedule(1, 1, 0)[0]
    entrance = type("Entrance", (), {"door": (0.0, 0.0)})
    newcomer = Guest(plan, room, entrance, None)
    newcomer._go_to_waiting_place = lambda: None
    newcomer._come_in()
    assert said == [f"players: {plan.name} cannot come in yet: {plan.name}: ben is there"] * 2
