# SPDX-License-Identifier: Apache-2.0
"""Where the players stand, sit and walk fits the world file."""

import math

import numpy as np
import pytest

from merlin_guests.guest import BLOCKED
from merlin_guests.places import BODY, FROM_ROBOT, ROBOT_RADIUS, THING, Places, shortened
from merlin_guests.schedule import TABLES
from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import find_world, load_world
from merlin_sim.world.world_model import Person, Point

WORLD = load_world(find_world("restaurant"))
PLACES = Places(WORLD)
ROOM = PathPlanner(map_of(WORLD), BODY, 0.0)


def room(place: Point) -> float:
    """m to the nearest obstacle."""
    return float(ROOM.rooms(np.array([place]))[0])


@pytest.mark.parametrize("table", TABLES)
def test_guests_reach_every_seat_and_leave_again(table: str) -> None:
    seat, yaw = PLACES.seat(table)
    way = PLACES.way(PLACES.door, seat)
    assert len(way) > 1, "there is no way round the furniture"
    assert math.dist(way[-1], seat) < 0.1
    middle = next(solid for solid in WORLD.furniture if solid.name == table).pose.point
    assert math.isclose(math.dist(seat, middle), 0.85, abs_tol=0.02)
    looks = (seat[0] + 0.85 * math.cos(yaw), seat[1] + 0.85 * math.sin(yaw))
    assert math.dist(looks, middle) < 0.05


@pytest.mark.parametrize("number", range(4))
def test_who_waits_stands_free_and_near_enough_to_be_seen(number: int) -> None:
    place = PLACES.queue[number]
    assert room(place) > BODY
    assert math.dist(place, PLACES.queue[0]) < 1.0
    assert all(math.dist(place, other) > 0.5 for other in PLACES.queue if other != place)


@pytest.mark.parametrize("distance", BLOCKED)
@pytest.mark.parametrize("table", TABLES)
def test_a_chair_in_the_way_stands_on_the_way_and_lets_the_robot_arrive(table: str, distance: float) -> None:
    place = PLACES.on_the_way(table, "bar", distance)
    assert room(place) > 0.2
    assert math.dist(place, WORLD.points_of_interest[table].point) < distance + 0.01
    assert all(math.dist(place, poi.point) > 0.6 for poi in WORLD.points_of_interest.values())


@pytest.mark.parametrize("table", TABLES)
def test_who_follows_round_a_table_does_not_walk_into_it(table: str) -> None:
    seat, _ = PLACES.seat(table)
    robot = WORLD.points_of_interest[table].point
    way = PLACES.way_near(seat, robot, 0.9)
    assert all(room(place) > 0.0 for place in way[:-1])
    assert room(way[-1]) > BODY - 0.05
    assert math.dist(way[-1], robot) < 0.91


def test_a_way_is_shortened_from_its_end() -> None:
    way = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0)]
    assert shortened(way, 0.5) == [(0.0, 0.0), (2.0, 0.0), (2.0, 0.5)]
    assert shortened(way, 1.5) == [(0.0, 0.0), (1.5, 0.0)]
    assert shortened(way, 5.0) == [(0.0, 0.0)]


def test_dishes_stand_on_the_bar_where_the_robot_looks() -> None:
    counter = next(solid for solid in WORLD.furniture if solid.name == "bar_counter")
    for number in range(3):
        x, y = PLACES.on_bar(counter.pose.point, number)
        assert abs(x) < counter.size[0] / 2 and abs(y) < counter.size[1] / 2


@pytest.mark.parametrize("table", TABLES)
def test_who_was_guided_gets_past_the_robot_to_the_seat(table: str) -> None:
    robot, (seat, _) = WORLD.points_of_interest[table], PLACES.seat(table)
    here = (robot.x - 0.95 * math.cos(robot.yaw), robot.y - 0.95 * math.sin(robot.yaw))
    way = [here, *PLACES.way_round([robot.point], [], here, seat)]
    assert math.dist(way[-1], seat) < 0.1
    kept = ROBOT_RADIUS + Person.radius + FROM_ROBOT  # nearer, the world lets no person walk
    for start, end in zip(way, way[1:]):
        for part in np.linspace(0.0, 1.0, 30):
            place = [a + part * (b - a) for a, b in zip(start, end)]
            assert math.dist(place, robot.point) > kept


def test_a_thing_that_is_not_on_the_map_is_walked_round() -> None:
    far, door = (9.0, 9.0), PLACES.door
    seat, _ = PLACES.seat("table_6")
    chair = PLACES.on_the_way("table_6", "entrance", 1.5)
    way = [seat, *PLACES.way_round([far], [chair], seat, door)]
    assert math.dist(way[-1], door) < 0.1
    places = [np.linspace(a, b, 30) for a, b in zip(way, way[1:])]
    assert np.hypot(*(np.concatenate(places) - chair).T).min() > THING + BODY
