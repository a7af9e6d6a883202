"""Shortest paths of a disc-shaped robot on an occupancy grid, in any direction.

The obstacles grow by the robot's radius, so the robot becomes a point. A shortest path then consists of
straight lines between convex corners of the grown obstacles, each of which touches the corners at its
ends; these lines are the edges of a visibility graph, in which Dijkstra's algorithm finds the path.
Exact up to the resolution of the grid, unlike the paths of a search over cells.
"""

import heapq
import math
from typing import Dict, List, Tuple

import cv2
import numpy as np

Point = Tuple[float, float]

NUDGE = 0.05
"""Distance by which corners are moved off their obstacle, cells."""
SAMPLE = 0.5
"""Distance of the points at which a line is tested against the grid, cells."""


class NoPathError(ValueError):
    """No path leads from one point to the other."""


class ShortestPaths:
    """Shortest paths on one map."""

    def __init__(self, occupied: np.ndarray, resolution: float, origin: Point, radius: float) -> None:
        """
        Parameters:
            occupied: true where there is an obstacle; row = y, column = x.
            resolution: edge of a cell, m.
            origin: map coordinates of the outer corner of cell (0, 0), m.
            radius: of the robot, m.
        """
        self._resolution = resolution
        self._origin = np.asarray(origin)
        framed = np.pad(occupied.astype(bool), 1, constant_values=True)
        distance = cv2.distanceTransform((~framed).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        self._blocked = distance[1:-1, 1:-1] * resolution < radius
        self._corners, self._quadrants = self._find_corners()
        self._edges = self._find_edges()
        self._trees: Dict[Point, Tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def path(self, start: Point, goal: Point) -> List[Point]:
        """The shortest path.

        Parameters:
            start: map coordinates, m.
            goal: map coordinates, m. Paths to the same goal share most of the work.

        Returns:
            Its vertices, start and goal included.

        Raises:
            NoPathError: there is none.
        """
        if goal not in self._trees:
            self._trees[goal] = self._tree(self._free_cell(goal))
        lengths, successors, goal_cell = self._trees[goal]
        start_cell = self._free_cell(start)
        if self._visible(start_cell[None], goal_cell[None])[0]:
            return [start, goal]
        seen = self._seen_from(start_cell)
        totals = np.where(seen, lengths + np.hypot(*(self._corners - start_cell).T), np.inf)
        if not len(totals) or not np.isfinite(totals.min()):
            raise NoPathError(f"no way for the robot from {start} to {goal} on the map")
        vertices, corner = [start], int(totals.argmin())
        while corner >= 0:
            vertices.append(self._to_map(self._corners[corner]))
            corner = int(successors[corner])
        return [*vertices, goal]

    def _find_corners(self) -> Tuple[np.ndarray, np.ndarray]:
        """Cell corners with one blocked cell around: positions (cells), and on which side the cell is."""
        blocked = self._blocked
        around = {
            (-1, -1): blocked[:-1, :-1],
            (1, -1): blocked[:-1, 1:],
            (-1, 1): blocked[1:, :-1],
            (1, 1): blocked[1:, 1:],
        }
        single = sum(part.astype(int) for part in around.values()) == 1
        positions, quadrants = [], []
        for (side_x, side_y), part in around.items():
            rows, columns = np.nonzero(single & part)
            corner = np.stack([columns + 1.0, rows + 1.0], axis=1)
            positions.append(corner - NUDGE * np.array([side_x, side_y]))
            quadrants.append(np.tile([side_x, side_y], (len(rows), 1)))
        return np.concatenate(positions), np.concatenate(quadrants)

    def _touches(self, corner: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Whether a line through a corner touches its obstacle, instead of hitting or leaving it."""
        along = self._quadrants[corner] * direction
        return along[..., 0] * along[..., 1] <= 0

    def _find_edges(self) -> List[Tuple[np.ndarray, np.ndarray]]:
        """For each corner: the corners it sees over lines that touch both, and their distances (cells)."""
        count = len(self._corners)
        edges = []
        everything = np.arange(count)
        for index in range(count):
            direction = self._corners - self._corners[index]
            useful = self._touches(np.full(count, index), direction) & self._touches(everything, direction)
            useful[index] = False
            others = np.nonzero(useful)[0]
            seen = self._visible(
                np.repeat(self._corners[index][None], len(others), axis=0), self._corners[others]
            )
            others = others[seen]
            edges.append((others, np.hypot(*direction[others].T)))
        return edges

    def _seen_from(self, point: np.ndarray) -> np.ndarray:
        """Which corners a point sees over a line that touches them."""
        count = len(self._corners)
        useful = self._touches(np.arange(count), self._corners - point)
        others = np.nonzero(useful)[0]
        useful[others] = self._visible(np.repeat(point[None], len(others), axis=0), self._corners[others])
        return useful

    def _visible(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Whether the lines between pairs of points (cells) are free."""
        if not len(starts):
            return np.zeros(0, dtype=bool)
        lengths = np.hypot(*(ends - starts).T)
        free = np.ones(len(starts), dtype=bool)
        samples = np.maximum(2, np.ceil(lengths / SAMPLE).astype(int) + 1)
        # Lines of similar length share one array: a long one would make the short ones expensive.
        for size in (16, 64, 256, int(samples.max())):
            batch = np.nonzero(free & (samples <= size) & (samples > 0))[0]
            if not len(batch):
                continue
            fractions = np.linspace(0.0, 1.0, size)[None, :, None]
            points = starts[batch, None] + fractions * (ends[batch] - starts[batch])[:, None]
            free[batch] = ~self._lookup(points).any(axis=1)
            samples[batch] = 0
        return free

    def _lookup(self, points: np.ndarray) -> np.ndarray:
        cells = np.floor(points).astype(int)
        rows = np.clip(cells[..., 1], 0, self._blocked.shape[0] - 1)
        columns = np.clip(cells[..., 0], 0, self._blocked.shape[1] - 1)
        return self._blocked[rows, columns]

    def _tree(self, goal: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the shortest paths from all corners to a goal: lengths (cells), next corners (-1: goal)."""
        lengths = np.full(len(self._corners), np.inf)
        successors = np.full(len(self._corners), -1)
        seen = np.nonzero(self._seen_from(goal))[0]
        lengths[seen] = np.hypot(*(self._corners[seen] - goal).T)
        queue = [(length, int(corner)) for length, corner in zip(lengths[seen], seen)]
        heapq.heapify(queue)
        while queue:
            length, corner = heapq.heappop(queue)
            if length > lengths[corner]:
                continue
            others, steps = self._edges[corner]
            better = length + steps < lengths[others] - 1e-9
            for other, total in zip(others[better], (length + steps)[better]):
                lengths[other], successors[other] = total, corner
                heapq.heappush(queue, (total, int(other)))
        return lengths, successors, goal

    def _free_cell(self, point: Point) -> np.ndarray:
        """A point in cells; one inside a grown obstacle (real robots stand closer) moves out of it."""
        position = (np.asarray(point) - self._origin) / self._resolution
        if not self._lookup(position):
            return position
        rows, columns = np.nonzero(~self._blocked)
        if not len(rows):
            raise NoPathError("the robot fits nowhere on the map")
        centres = np.stack([columns, rows], axis=1) + 0.5
        return centres[np.hypot(*(centres - position).T).argmin()]

    def _to_map(self, cell: np.ndarray) -> Point:
        x, y = cell * self._resolution + self._origin
        return float(x), float(y)


def path_length(vertices: List[Point]) -> float:
    """Length of a polyline, m."""
    return sum(math.dist(a, b) for a, b in zip(vertices, vertices[1:]))


def bend_angles(vertices: List[Point]) -> List[float]:
    """By how much the direction changes at each inner vertex, rad, ≥ 0."""
    headings = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in zip(vertices, vertices[1:]) if a != b]
    return [abs(angle_between(a, b)) for a, b in zip(headings, headings[1:])]


def angle_between(start: float, end: float) -> float:
    """The smaller turn from one heading to another, rad, in (-pi, pi]."""
    return math.pi - (math.pi - (end - start)) % (2 * math.pi)
