"""Occupancy grids: what map_server would publish for a world, and the geometry of cells."""

import math
from dataclasses import dataclass
from typing import Iterable, List, Optional, Tuple

import cv2
import numpy as np

from merlin_sim.world import Point, Solid, World

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
MARGIN = 0.5  # m of map around the walls


@dataclass
class OccupancyGrid:
    """A map: cells by row (y) and column (x), values as in nav_msgs/OccupancyGrid.

    `origin` is the corner of cell (0, 0) in the map frame, m; the map is not rotated.
    """

    cells: np.ndarray
    resolution: float
    origin: Point

    def cell(self, point: Point) -> Optional[Tuple[int, int]]:
        """The row and column of a point, or None outside the map."""
        column = (point[0] - self.origin[0]) / self.resolution
        row = (point[1] - self.origin[1]) / self.resolution
        rows, columns = self.cells.shape
        # Compared before rounding: a number that is none, or too large for a whole one, is outside too.
        return (int(row), int(column)) if 0 <= row < rows and 0 <= column < columns else None

    def point(self, row: float, column: float) -> Point:
        """The centre of a cell, m."""
        return (
            self.origin[0] + (column + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )

    def rows_and_columns(self, points: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and columns of points (n x 2), and which of the points lie on the map."""
        columns = np.floor((points[:, 0] - self.origin[0]) / self.resolution).astype(int)
        rows = np.floor((points[:, 1] - self.origin[1]) / self.resolution).astype(int)
        height, width = self.cells.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return rows, columns, inside

    def mark(self, solid: Solid, value: int = OCCUPIED) -> None:
        """Marks every cell whose centre lies in a thing."""
        corners = np.array(solid.corners())
        low = np.floor((corners.min(axis=0) - self.origin) / self.resolution).astype(int)
        high = np.ceil((corners.max(axis=0) - self.origin) / self.resolution).astype(int) + 1
        rows = np.arange(max(low[1], 0), min(high[1], self.cells.shape[0]))
        columns = np.arange(max(low[0], 0), min(high[0], self.cells.shape[1]))
        if not len(rows) or not len(columns):
            return
        x = self.origin[0] + (columns[None, :] + 0.5) * self.resolution - solid.pose.x
        y = self.origin[1] + (rows[:, None] + 0.5) * self.resolution - solid.pose.y
        if solid.radius is not None:
            within = x * x + y * y <= solid.radius**2
        else:
            assert solid.size is not None
            cos, sin = math.cos(solid.pose.yaw), math.sin(solid.pose.yaw)
            within = (np.abs(cos * x + sin * y) <= solid.size[0] / 2 + 1e-9) & (
                np.abs(cos * y - sin * x) <= solid.size[1] / 2 + 1e-9
            )
        self.cells[np.ix_(rows, columns)] = np.where(within, value, self.cells[np.ix_(rows, columns)])


def map_of(world: World) -> OccupancyGrid:
    """The map of a world as it was surveyed: walls and mapped furniture; doors open unless they began closed.

    What cannot be reached from any start or point of interest is unknown.
    """
    solids: List[Solid] = world.wall_solids() + world.furniture
    solids += [door.leaf(world.wall_thickness, world.wall_height) for door in world.doors if not door.open]
    left, bottom, right, top = world.bounds()
    resolution = world.resolution
    # A whole number of cells from the origin keeps walls that lie on the raster sharp.
    origin = (
        math.floor((left - MARGIN) / resolution) * resolution,
        math.floor((bottom - MARGIN) / resolution) * resolution,
    )
    shape = (
        math.ceil((top + MARGIN - origin[1]) / resolution),
        math.ceil((right + MARGIN - origin[0]) / resolution),
    )
    grid = OccupancyGrid(np.zeros(shape, dtype=np.int8), resolution, origin)
    for solid in solids:
        grid.mark(solid)
    _hide_unreachable(grid, [pose.point for pose in [*world.points_of_interest.values(), *world.starts]])
    return grid


def _hide_unreachable(grid: OccupancyGrid, seen: Iterable[Point]) -> None:
    free = (grid.cells == FREE).astype(np.uint8)
    _, labels = cv2.connectedComponents(free, connectivity=4)
    inside = {labels[cell] for cell in map(grid.cell, seen) if cell is not None and free[cell]}
    grid.cells[(free == 1) & ~np.isin(labels, list(inside))] = UNKNOWN
