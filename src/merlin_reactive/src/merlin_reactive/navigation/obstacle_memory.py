# SPDX-License-Identifier: Apache-2.0
"""What the laser saw that is not on the map, until it is seen to be gone or forgotten."""

import math

import numpy as np

from merlin_reactive.occupancy_grid import OccupancyGrid, hit_points
from merlin_reactive.pose import Point, Pose

OFF_MAP = 0.15  # m from the nearest obstacle of the map from which a hit counts as new
CLEARED = 0.15  # m that a ray must reach beyond a remembered obstacle to prove that it has gone


class ObstacleMemory:
    """Cells of the map's raster that something stands on.

    :param distance: distance of each cell to the nearest obstacle of the map, m.
    :param keep: s for which something unseen is remembered.
    """

    def __init__(self, grid: OccupancyGrid, distance: np.ndarray, keep: float) -> None:
        self._grid = grid
        self._distance = distance
        self._keep = keep
        self._seen = np.full(distance.shape, -np.inf)  # when something was last seen there, s
        self._known = np.nonzero(np.isfinite(self._seen))  # the cells that are remembered

    def see(self, pose: Pose, angles: np.ndarray, ranges: np.ndarray, now: float) -> None:
        """Takes a scan made at a pose; angles (rad, ascending and even) relative to it, ranges in m."""
        self._clear(pose, angles, ranges)
        rows, columns, inside = self._grid.rows_and_columns(hit_points(pose, angles, ranges))
        rows, columns = rows[inside], columns[inside]
        new = self._distance[rows, columns] > OFF_MAP
        self._seen[rows[new], columns[new]] = now
        self._known = np.nonzero(np.isfinite(self._seen))

    def points(self, now: float) -> np.ndarray:
        """The centres (n x 2) of the cells with something on them."""
        rows, columns = self._known
        fresh = self._seen[rows, columns] > now - self._keep
        return self._grid.points(rows[fresh], columns[fresh])

    def forget_near(self, point: Point, radius: float) -> None:
        """Forgets what was seen within a radius (m) of a point."""
        rows, columns = self._known
        places = self._grid.points(rows, columns)
        near = np.hypot(places[:, 0] - point[0], places[:, 1] - point[1]) < radius
        self._seen[rows[near], columns[near]] = -np.inf
        self._known = rows[~near], columns[~near]

    def forget(self) -> None:
        """Forgets all obstacles that were seen."""
        self._seen.fill(-np.inf)
        self._known = np.nonzero(np.isfinite(self._seen))

    def _clear(self, pose: Pose, angles: np.ndarray, ranges: np.ndarray) -> None:
        rows, columns = self._known
        if not len(rows):
            return
        dx, dy = (self._grid.points(rows, columns) - pose.point).T
        bearing = np.arctan2(dy, dx) - pose.yaw - angles[0]
        ray = np.round(np.mod(bearing, 2 * math.pi) / (angles[1] - angles[0])).astype(int)
        covered = ray < len(angles)
        ray[~covered] = 0
        # A neighbouring ray that passes proves nothing: all three must.
        reached = np.minimum(np.minimum(ranges[ray - 1], ranges[ray]), ranges[(ray + 1) % len(ranges)])
        gone = covered & (reached > np.hypot(dx, dy) + CLEARED)
        self._seen[rows[gone], columns[gone]] = -np.inf
