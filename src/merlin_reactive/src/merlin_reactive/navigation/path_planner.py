# SPDX-License-Identifier: Apache-2.0
"""Shortest safe paths for a disc on an occupancy grid."""

import math
from typing import List, Optional, Sequence, Tuple

import numpy as np
import pyastar2d

from merlin_reactive.distance_field import distance_field
from merlin_reactive.occupancy_grid import FREE, OccupancyGrid
from merlin_reactive.pose import Point

COMFORT = 0.08  # m beyond the clearance up to which closeness costs extra
COMFORT_COST = 0.3  # extra cost per metre at the clearance itself
ESCAPE = 0.6  # m around the start in which the robot may squeeze out of what is too close
ESCAPE_COST = 30.0  # per metre
STRIDES = (0.3, 0.1)  # m between the points that a path is straightened over, the second if the first fails
# Parts of the way to its neighbours' line that a corner is tried to be moved by.
PULLS = (1.0, 0.5, 0.25, 0.1)
PASSES = 6  # over all corners
SAMPLE = 0.025  # m between the points at which a straight piece is checked


class NoPath(Exception):
    """No path exists; the text says why."""


class PathPlanner:
    """Plans on one map, to which obstacles seen since can be added per call.

    :param grid: unknown cells count as obstacles.
    :param radius: of the robot, m.
    :param clearance: that it keeps from obstacles besides, m.
    """

    def __init__(self, grid: OccupancyGrid, radius: float, clearance: float) -> None:
        self.grid = grid
        self.radius = radius
        self.clearance = clearance
        self.distance = self._distances(grid.cells == FREE)

    def rooms(self, points: np.ndarray) -> np.ndarray:
        """Distances to the nearest obstacle of the map, m; 0 outside the map.

        :param points: n x 2.
        """
        rows, columns, inside = self.grid.rows_and_columns(points)
        found = np.zeros(len(points))
        found[inside] = self.distance[rows[inside], columns[inside]]
        return found

    def nearest(self, point: Point, tolerance: float) -> Optional[Point]:
        """The point nearest to another one where the robot can stand; None: none within the tolerance (m)."""
        rows, columns = np.nonzero((self.distance >= self.radius) & (self.grid.cells == FREE))
        if not len(rows):
            return None
        centres = self.grid.points(rows, columns)
        away = np.hypot(centres[:, 0] - point[0], centres[:, 1] - point[1])
        best = int(np.argmin(away))
        return (float(centres[best, 0]), float(centres[best, 1])) if away[best] <= tolerance else None

    def why_unreachable(self, point: Point) -> str:
        """Why the robot can never stand at a point of the map; empty when it can."""
        where = f"the goal ({point[0]:.2f}, {point[1]:.2f})"
        cell = self.grid.cell(point)
        if cell is None:
            return f"{where} lies outside the map"
        if self.grid.cells[cell] > FREE:
            return f"{where} lies inside an obstacle of the map"
        if self.grid.cells[cell] != FREE:
            return f"{where} lies in unknown space"
        if self.distance[cell] < self.radius:
            gap = f"{self.distance[cell]:.2f} m"
            return f"{where} is {gap} from an obstacle, less than the robot's radius of {self.radius:.2f} m"
        return ""

    def plan(
        self,
        start: Point,
        goal: Point,
        obstacles: Optional[np.ndarray] = None,
        clearance: Optional[float] = None,
    ) -> List[Point]:
        """The path from start to goal, as the corners of a polyline.

        :param obstacles: points (n x 2, m) that are in the way besides the map.
        :param clearance: instead of the planner's own, m.
        :raises NoPath: when no path exists.
        """
        reason = self.why_unreachable(goal)
        if reason:
            raise NoPath(reason)
        start_cell, goal_cell = self.grid.cell(start), self.grid.cell(goal)
        if start_cell is None:
            raise NoPath(f"the robot is at ({start[0]:.2f}, {start[1]:.2f}), outside the map")
        assert goal_cell is not None
        safe = self.radius + (self.clearance if clearance is None else clearance)
        distance = self.distance
        if obstacles is not None and len(obstacles):
            free = np.ones(self.grid.cells.shape, bool)
            rows, columns, inside = self.grid.rows_and_columns(obstacles)
            free[rows[inside], columns[inside]] = False
            distance = np.minimum(distance, self._distances(free, safe + COMFORT))
            if distance[goal_cell] < self.radius:
                raise NoPath(f"something stands at the goal ({goal[0]:.2f}, {goal[1]:.2f})")
        costs = self._costs(distance, safe, start_cell, goal_cell)
        cells = pyastar2d.astar_path(costs, start_cell, goal_cell, allow_diagonal=True)
        # A* may pass cells of infinite cost when nothing else is left.
        if cells is None or np.isinf(costs[cells[:, 0], cells[:, 1]]).any():
            ends = f"from ({start[0]:.2f}, {start[1]:.2f}) to ({goal[0]:.2f}, {goal[1]:.2f})"
            raise NoPath(f"no way {ends} is wide enough")
        points = [self.grid.point(row, column) for row, column in cells]
        return self._straightened([start, *points[1:-1], goal], costs)

    def _distances(self, free: np.ndarray, most: float = math.inf) -> np.ndarray:
        """Of each cell, m; exact up to `most`."""
        resolution = self.grid.resolution
        cells = None if math.isinf(most) else math.ceil(most / resolution + 0.5)
        # From centre to centre; the obstacle begins half a cell earlier.
        return np.maximum(distance_field(free, cells) * resolution - resolution / 2, 0.0)

    def _costs(
        self, distance: np.ndarray, safe: float, start: Tuple[int, int], goal: Tuple[int, int]
    ) -> np.ndarray:
        closeness = np.clip((safe + COMFORT - distance) / COMFORT, 0.0, 1.0)
        costs = (1.0 + COMFORT_COST * closeness**2).astype(np.float32)
        blocked = distance < safe
        costs[blocked] = np.inf
        rows, columns = np.indices(distance.shape, sparse=True)
        for cell, least in ((start, 0.0), (goal, self.radius)):
            if blocked[cell]:
                near = (rows - cell[0]) ** 2 + (columns - cell[1]) ** 2 <= (
                    ESCAPE / self.grid.resolution
                ) ** 2
                costs[near & blocked & (distance >= least) & (distance > 0)] = ESCAPE_COST
        costs[start] = min(costs[start], ESCAPE_COST)
        return costs

    def _straightened(self, points: Sequence[Point], costs: np.ndarray) -> List[Point]:
        for stride in STRIDES:
            path = self._shortcut(points, costs, max(1, round(stride / self.grid.resolution)))
            if path:
                return self._tightened(path, costs)
        return list(points)  # the raster path squeezes through where no straight line does

    def _shortcut(self, points: Sequence[Point], costs: np.ndarray, step: int) -> List[Point]:
        """The cheapest polyline through every step-th point, by dynamic programming; or nothing."""
        kept = [*points[:-1:step], points[-1]]
        places = np.array(kept)
        best = np.full(len(kept), math.inf)
        before = np.zeros(len(kept), dtype=int)
        best[0] = 0.0
        for last in range(1, len(kept)):
            totals = best[:last] + self._straight_costs(places[:last], places[last], costs)
            before[last] = int(np.argmin(totals))
            best[last] = totals[before[last]]
        if math.isinf(best[-1]):
            return []
        path = [len(kept) - 1]
        while path[-1] != 0:
            path.append(int(before[path[-1]]))
        return [kept[index] for index in reversed(path)]

    def _tightened(self, path: List[Point], costs: np.ndarray) -> List[Point]:
        """Pulls the corners towards the lines between their neighbours, as a rubber band would."""

        def around(before: Point, corner: Point, after: Point) -> float:
            return self._straight_cost(before, corner, costs) + self._straight_cost(corner, after, costs)

        for _ in range(PASSES):
            moved = False
            index = 1
            while index < len(path) - 1:
                before, corner, after = path[index - 1 : index + 2]
                now = around(before, corner, after)
                if self._straight_cost(before, after, costs) <= now:
                    del path[index]
                    moved = True
                    continue
                target = _foot(before, corner, after)
                for part in PULLS:
                    tried = (
                        corner[0] + part * (target[0] - corner[0]),
                        corner[1] + part * (target[1] - corner[1]),
                    )
                    if around(before, tried, after) < now - 1e-4:
                        path[index] = tried
                        moved = True
                        break
                index += 1
            if not moved:
                break
        return path

    def _straight_cost(self, start: Point, end: Point, costs: np.ndarray) -> float:
        return float(self._straight_costs(np.array([start]), np.array(end), costs)[0])

    def _straight_costs(self, starts: np.ndarray, end: np.ndarray, costs: np.ndarray) -> np.ndarray:
        """What straight lines from points (n x 2) to one point cost."""
        offsets = end - starts
        lengths = np.hypot(offsets[:, 0], offsets[:, 1])
        samples = max(2, math.ceil(lengths.max() / SAMPLE) + 1)
        along = np.arange(samples) / (samples - 1)
        begin = (starts - self.grid.origin) / self.grid.resolution
        steps = offsets / self.grid.resolution
        columns = (begin[:, :1] + along * steps[:, :1]).astype(int)
        rows = (begin[:, 1:] + along * steps[:, 1:]).astype(int)
        return costs[rows, columns].sum(axis=1) / samples * lengths


def _foot(before: Point, corner: Point, after: Point) -> Point:
    """The point of the line between the neighbours that is nearest to a corner."""
    dx, dy = after[0] - before[0], after[1] - before[1]
    square = dx * dx + dy * dy
    if square == 0.0:
        return before
    part = ((corner[0] - before[0]) * dx + (corner[1] - before[1]) * dy) / square
    part = max(0.0, min(1.0, part))
    return (before[0] + part * dx, before[1] + part * dy)
