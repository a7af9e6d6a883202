# SPDX-License-Identifier: Apache-2.0
"""Occupancy grids: values as in nav_msgs/OccupancyGrid, and the geometry of cells."""

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from merlin_reactive.pose import Point, Pose

FREE, OCCUPIED, UNKNOWN = 0, 100, -1


@dataclass
class OccupancyGrid:
    """A map: cells by row (y) and column (x), values as in nav_msgs/OccupancyGrid.

    `origin` is the corner of cell (0, 0) in the map frame, m; the map is not rotated.
    """

    cells: np.ndarray
    resolution: float
    origin: Point

    def same(self, other: "OccupancyGrid") -> bool:
        """Whether it is the same map."""
        place = self.resolution, self.origin
        return place == (other.resolution, other.origin) and np.array_equal(self.cells, other.cells)

    def cell(self, point: Point) -> Optional[Tuple[int, int]]:
        """The row and column of a point, or None outside the map."""
        column = (point[0] - self.origin[0]) / self.resolution
        row = (point[1] - self.origin[1]) / self.resolution
        rows, columns = self.cells.shape
        # Compared before rounding: NaN and numbers too large for an integer are outside, too.
        return (int(row), int(column)) if 0 <= row < rows and 0 <= column < columns else None

    def point(self, row: float, column: float) -> Point:
        """The centre of a cell, m."""
        return (
            self.origin[0] + (column + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )

    def points(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """The centres of cells, m: n x 2."""
        return np.column_stack(self.origin) + (np.column_stack((columns, rows)) + 0.5) * self.resolution

    def rows_and_columns(self, points: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and columns of points (n x 2), and which of the points lie on the map."""
        columns = np.floor((points[:, 0] - self.origin[0]) / self.resolution).astype(int)
        rows = np.floor((points[:, 1] - self.origin[1]) / self.resolution).astype(int)
        height, width = self.cells.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return rows, columns, inside


def hit_points(laser: Pose, angles: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """The points (n x 2, m) that a laser's rays hit, in the frame in which it has this pose.

    :param angles: of the rays relative to it (rad), ranges in m, infinite where nothing was hit.
    """
    hit = np.isfinite(ranges)
    bearing = angles[hit] + laser.yaw
    return np.stack(
        [laser.x + ranges[hit] * np.cos(bearing), laser.y + ranges[hit] * np.sin(bearing)], axis=1
    )
