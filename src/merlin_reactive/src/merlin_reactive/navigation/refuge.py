# SPDX-License-Identifier: Apache-2.0
"""Where a robot goes that stands in the way of others: the nearest place at which they can pass."""

import math
from typing import Optional, Sequence

import numpy as np

from merlin_reactive.distance_field import distance_field
from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_reactive.navigation.right_of_way import ASIDE, PASSING, RobotWay
from merlin_reactive.pose import Point

REACH = 10.0  # m that a place may be away
STAND = 0.02  # m beyond the robot's radius that it keeps free where it stands aside


def nearest_refuge(
    planner: PathPlanner, here: Point, first: Sequence[RobotWay], others: Sequence[RobotWay], seen: np.ndarray
) -> Optional[Point]:
    """The nearest place off the ways of those that go first; None: it cannot reach one.

    A wave spreads over the free cells around the others' bodies, in turn to four and to eight neighbours.

    :param first: the robots that are given way.
    :param others: all robots, which it cannot pass through.
    :param seen: points (n x 2) that are in the way besides the map.
    """
    grid = planner.grid
    start = grid.cell(here)
    if start is None:
        return None
    widths = [other.radius for other in others]
    bodies = np.array([other.pose.point for other in others]).reshape(-1, 2)
    stand = planner.radius + STAND
    free = (planner.distance >= stand) & ~_near(planner, seen, stand)
    free &= ~_near(planner, bodies, planner.radius + max(widths, default=0.0) + PASSING / 2)
    good = free.copy()
    for other in first:
        good &= ~_near(planner, other.way, planner.radius + other.radius + ASIDE)
    wave = np.zeros_like(free)
    wave[start] = True
    for turn in range(int(REACH / grid.resolution)):
        spread = _spread(wave, corners=turn % 2 == 1) & (free | wave)
        found = [grid.point(int(row), int(column)) for row, column in np.argwhere(spread & good)]
        if found:
            return max(found, key=lambda point: _room(planner, point, seen))
        if (spread == wave).all():
            return None
        wave = spread
    return None


def _near(planner: PathPlanner, points: np.ndarray, reach: float) -> np.ndarray:
    """The cells that are nearer than that to the nearest of some points.

    :param reach: m.
    """
    grid = planner.grid
    empty = np.ones(grid.cells.shape, bool)
    rows, columns, inside = grid.rows_and_columns(points)
    empty[rows[inside], columns[inside]] = False
    cells = reach / grid.resolution
    return distance_field(empty, math.ceil(cells)) < cells


def _spread(wave: np.ndarray, corners: bool) -> np.ndarray:
    """The cells of a wave and their neighbours.

    :param corners: also those that touch it with a corner only.
    """
    spread = wave.copy()
    spread[1:] |= wave[:-1]
    spread[:-1] |= wave[1:]
    source = spread.copy() if corners else wave
    spread[:, 1:] |= source[:, :-1]
    spread[:, :-1] |= source[:, 1:]
    return spread


def _room(planner: PathPlanner, point: Point, seen: np.ndarray) -> float:
    """Distance of a point to what is next to it, m."""
    cell = planner.grid.cell(point)
    assert cell is not None
    from_seen = np.linalg.norm(np.reshape(seen, (-1, 2)) - point, axis=1).min(initial=math.inf)
    return min(float(planner.distance[cell]), float(from_seen))
