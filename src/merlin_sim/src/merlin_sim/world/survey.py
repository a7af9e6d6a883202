# SPDX-License-Identifier: Apache-2.0
"""The map of a world as a survey would draw it: what map_server would publish."""

import math
from typing import Iterable, List, Tuple

import numpy as np
from scipy.ndimage import label

from merlin_reactive.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from merlin_sim.world.world_model import Solid, World

MARGIN = 0.5  # m of map around the walls


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
        mark(grid, solid)
    free = grid.cells == FREE
    seen = (grid.cell(pose.point) for pose in [*world.points_of_interest.values(), *world.starts])
    grid.cells[free & ~reachable(free, [cell for cell in seen if cell is not None])] = UNKNOWN
    return grid


def reachable(free: np.ndarray, starts: Iterable[Tuple[int, int]]) -> np.ndarray:
    """The free cells that are connected with one of some cells over their edges.

    :param free: by row and column, boolean.
    :param starts: rows and columns; those that are not free count for nothing.
    """
    parts, _ = label(free)
    return free & np.isin(parts, [parts[start] for start in starts if free[start]])


def mark(grid: OccupancyGrid, solid: Solid) -> None:
    """Marks every cell whose centre lies in a thing."""
    corners = np.array(solid.corners())
    low = np.floor((corners.min(axis=0) - grid.origin) / grid.resolution).astype(int)
    high = np.ceil((corners.max(axis=0) - grid.origin) / grid.resolution).astype(int) + 1
    rows = np.arange(max(low[1], 0), min(high[1], grid.cells.shape[0]))
    columns = np.arange(max(low[0], 0), min(high[0], grid.cells.shape[1]))
    if not len(rows) or not len(columns):
        return
    x = grid.origin[0] + (columns[None, :] + 0.5) * grid.resolution - solid.pose.x
    y = grid.origin[1] + (rows[:, None] + 0.5) * grid.resolution - solid.pose.y
    if solid.radius is not None:
        within = x * x + y * y <= solid.radius**2
    else:
        half_x, half_y = solid.half_size
        cos, sin = math.cos(solid.pose.yaw), math.sin(solid.pose.yaw)
        along, across = np.abs(cos * x + sin * y), np.abs(cos * y - sin * x)
        within = (along <= half_x + 1e-9) & (across <= half_y + 1e-9)
    grid.cells[np.ix_(rows, columns)] = np.where(within, OCCUPIED, grid.cells[np.ix_(rows, columns)])
