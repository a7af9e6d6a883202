# SPDX-License-Identifier: Apache-2.0
"""Where a robot goes that stands in the way of others: the nearest place at which they can pass."""

from typing import Optional, Sequence

import cv2
import numpy as np

from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_reactive.navigation.right_of_way import ASIDE, PASSING, RobotWay
from merlin_reactive.pose import Point

REACH = 10.0  # m that a place may be away
STAND = 0.02  # m beyond the robot's radius that it keeps free where it stands aside
CROSS, SQUARE = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8), np.ones((3, 3), np.uint8)


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
    room = np.minimum(planner.distance, _distance(planner, seen))
    bodies = np.array([other.pose.point for other in others]).reshape(-1, 2)
    widths = [other.radius for other in others]
    far = _distance(planner, bodies) >= planner.radius + max(widths, default=0.0) + PASSING / 2
    free = ((room >= planner.radius + STAND) & far).astype(np.uint8)
    good = free.astype(bool)
    for other in first:
        good &= _distance(planner, other.way) >= planner.radius + other.radius + ASIDE
    wave = np.zeros_like(free)
    wave[start] = 1
    for turn in range(int(REACH / grid.resolution)):
        spread = cv2.dilate(wave, SQUARE if turn % 2 else CROSS) & (free | wave)
        found = np.argwhere((spread > 0) & good)
        if len(found):
            row, column = min(found, key=lambda cell: -room[tuple(cell)])
            return grid.point(int(row), int(column))
        if (spread == wave).all():
            return None
        wave = spread
    return None


def _distance(planner: PathPlanner, points: np.ndarray) -> np.ndarray:
    """Distance of each cell to the nearest of some points, m."""
    empty = np.ones(planner.grid.cells.shape, np.uint8)
    rows, columns, inside = planner.grid.rows_and_columns(points)
    if not inside.any():
        return np.full(empty.shape, np.inf)
    empty[rows[inside], columns[inside]] = 0
    return cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * planner.grid.resolution
