# SPDX-License-Identifier: Apache-2.0
"""Maps of worlds, and the plans that are made on them."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from merlin_reactive.navigation.path_follower import Path as Way
from merlin_reactive.navigation.path_planner import NoPath, PathPlanner
from merlin_reactive.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import load_world

WORLDS = Path(__file__).resolve().parents[4] / "src" / "merlin_sim" / "worlds"


@pytest.fixture(scope="module")
def apartment():
    return load_world(WORLDS / "apartment.yaml")


@pytest.fixture(scope="module")
def grid(apartment):
    return map_of(apartment)


@pytest.fixture(scope="module")
def planner(grid):
    return PathPlanner(grid, 0.25, 0.05)


def at(grid, x, y):
    return grid.cells[grid.cell((x, y))]


def test_the_map_shows_walls_and_furniture_and_open_doors(grid):
    assert at(grid, 4.5, 0.0) == OCCUPIED
    assert at(grid, 0.0, 1.0) == OCCUPIED, "the front door is closed"
    assert at(grid, 2.95, 4.4) == FREE, "the dorm door is open"
    assert at(grid, 1.0, 6.0) == OCCUPIED, "the bed"
    assert at(grid, 4.5, 3.4) == FREE
    assert at(grid, -0.3, 3.0) == UNKNOWN
    assert grid.cell((-5.0, 0.0)) is None


def test_cells_and_points_are_inverse(grid):
    for cell in ((0, 0), (10, 25), (grid.cells.shape[0] - 1, grid.cells.shape[1] - 1)):
        assert grid.cell(grid.point(*cell)) == cell


def test_the_points_of_interest_lie_as_far_apart_as_the_papers(apartment, planner):
    points = apartment.points_of_interest.values()
    lengths = [Way(planner.plan(a.point, b.point)).length for a, b in itertools.combinations(points, 2)]
    assert 7.0 <= sum(lengths) / len(lengths) <= 8.0


def test_paths_keep_their_distance_and_are_hardly_longer_than_needed(apartment, planner):
    points = apartment.points_of_interest
    path = Way(planner.plan(points["main_door"].point, points["kitchen"].point))
    places = path.at(np.arange(0.0, path.length, 0.05))
    assert planner.rooms(places).min() >= 0.27
    straight = points["main_door"].distance(points["kitchen"])
    assert straight <= path.length <= 1.2 * straight


def test_an_empty_room_is_crossed_in_a_straight_line():
    grid = OccupancyGrid(np.zeros((100, 100), dtype=np.int8), 0.05, (0.0, 0.0))
    path = PathPlanner(grid, 0.25, 0.05).plan((1.0, 1.0), (4.0, 3.0))
    assert path == [(1.0, 1.0), (4.0, 3.0)]


def test_what_was_seen_is_gone_round(planner):
    box = np.array([[x, y] for x in np.arange(4.5, 5.0, 0.05) for y in np.arange(3.2, 3.8, 0.05)])
    path = Way(planner.plan((3.6, 3.5), (6.0, 3.6), box))
    places = path.at(np.arange(0.0, path.length, 0.05))
    gaps = np.hypot(places[:, :1] - box[:, 0], places[:, 1:] - box[:, 1])
    assert gaps.min() >= 0.25


@pytest.mark.parametrize(
    ("goal", "word"),
    [
        ((20.0, 1.0), "outside the map"),
        ((1.0, 6.0), "inside an obstacle"),
        ((-0.3, 3.0), "unknown"),
        ((0.25, 3.0), "radius"),
    ],
)
def test_goals_that_cannot_be_reached(planner, goal, word):
    with pytest.raises(NoPath, match=word):
        planner.plan((2.6, 3.4), goal)


def test_a_closed_way_is_none(planner):
    wall = np.array([[5.7, y] for y in np.arange(1.3, 2.4, 0.02)])
    with pytest.raises(NoPath, match="no way from"):
        planner.plan((4.8, 2.2), (7.6, 1.2), wall)


def test_a_robot_too_close_to_something_gets_away(planner):
    path = planner.plan((2.6, 4.13), (4.8, 3.4))  # 0.22 m from the dorm's wall
    assert math.dist(path[-1], (4.8, 3.4)) == 0.0
