# SPDX-License-Identifier: Apache-2.0
"""Shortest paths of a disc among exact shapes.

The shapes grow by the disc's radius, so the disc becomes a point. A shortest path is then made of straight
lines that touch the grown corners, which are arcs of circles, and of parts of these arcs. The tangents are
the edges of a graph in which Dijkstra's algorithm finds the path; nothing is rasterised.
"""

import math
from typing import Callable, List, NamedTuple, Tuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from merlin_experiment.oracle.outlines import Outlines, Point

#: By which a line may seem to enter what it touches, m.
TOUCH = 1e-7
#: Points of a circle at which an arc is tested; a gap too narrow by 0.01 mm is found.
SAMPLES = 720
#: Lines tested at once.
BATCH = 4000
#: Farthest that a point inside an obstacle is moved, m.
AWAY = 1.0


class NoPathError(ValueError):
    """No path leads from one point to the other."""


class Route(NamedTuple):
    """A shortest path: its length (m), and points along it with arcs in small steps (m)."""

    length: float
    points: List[Point]

    @property
    def direction(self) -> float:
        """The heading of its first segment, rad; 0 for a path without length."""
        (x, y) = self.points[0]
        for next_x, next_y in self.points[1:]:
            if math.hypot(next_x - x, next_y - y) > 1e-6:
                return math.atan2(next_y - y, next_x - x)
        return 0.0


class _Lines(NamedTuple):
    """Straight pieces between circles; for both ends: number of the circle, angle on it (rad), the point."""

    circles: np.ndarray  # n x 2
    angles: np.ndarray  # n x 2
    points: np.ndarray  # n x 2 x 2

    def chosen(self, which: np.ndarray) -> "_Lines":
        return _Lines(*(part[which] for part in self))


class ShortestPaths:
    """Shortest paths in one place."""

    def __init__(self, outlines: Outlines, radius: float) -> None:
        """:param outlines: the obstacles.
        :param radius: of the robot, m.
        """
        self._outlines = outlines
        self._least = radius - TOUCH
        corners = [(*corner, shape.radius + radius) for shape in outlines.shapes for corner in shape.corners]
        circles = np.array(corners, dtype=float).reshape(-1, 3)
        turns = np.linspace(0.0, 2 * math.pi, SAMPLES, endpoint=False)
        rims = circles[:, None, :2] + circles[:, None, 2:] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
        free = self._free(self._outlines.to_points, rims.reshape(-1, 2)).reshape(-1, SAMPLES)
        used = free.any(axis=1)
        self._circles = circles[used]
        # Number of blocked samples before each, twice round: shows in one step whether an arc is free.
        blocked = np.concatenate([~free[used], ~free[used]], axis=1)
        self._blocked = np.concatenate(
            [np.zeros((len(blocked), 1), dtype=int), blocked.cumsum(axis=1)], axis=1
        )
        pairs = np.array([(i, j) for i in range(len(self._circles)) for j in range(i)], dtype=int)
        pairs = pairs.reshape(-1, 2)
        self._tangents = self._free_lines(self._between(pairs, self._circles))

    def path(self, start: Point, goal: Point) -> Route:
        """The shortest path.

        A point inside an obstacle (by as little as a map is off) is moved out of it at no cost.

        :param start: m.
        :param goal: m.
        :raises NoPathError: when no path exists.
        """
        begin, end = (self._outside(np.asarray(place, dtype=float)) for place in (start, goal))
        if self._free(self._outlines.to_lines, begin[None], end[None])[0]:
            return Route(math.dist(begin, end), [start, goal])
        count = len(self._circles)
        nodes = np.concatenate([self._circles, [[*begin, 0.0], [*end, 0.0]]])
        own = np.array([(point, i) for point in (count, count + 1) for i in range(count)], dtype=int)
        ends = self._free_lines(self._between(own.reshape(-1, 2), nodes))
        lines = _Lines(*(np.concatenate(parts) for parts in zip(self._tangents, ends)))
        return self._route(lines, nodes, start, goal)

    def _route(self, lines: _Lines, nodes: np.ndarray, start: Point, goal: Point) -> Route:
        count = len(self._circles)
        # A state is a place on a circle and the way round it, counter-clockwise or clockwise.
        spokes = lines.points - nodes[lines.circles][..., :2]
        along = lines.points[:, 1] - lines.points[:, 0]
        left = spokes[..., 0] * along[:, None, 1] - spokes[..., 1] * along[:, None, 0] > 0
        size = 2 * len(lines.circles)
        index = np.arange(size).reshape(-1, 2)
        states = index[:, :, None] + size * np.stack([~left, left], axis=-1)  # forwards, backwards
        lengths = np.hypot(*along.T)
        rows, columns, weights = [states[:, 0, 0], states[:, 1, 1]], [states[:, 1, 0], states[:, 0, 1]], []
        weights += [lengths, lengths]
        flat_circles, flat_angles = lines.circles.ravel(), lines.angles.ravel()
        for circle in range(count):
            here = np.nonzero(flat_circles == circle)[0]
            if len(here) < 2:
                continue
            here = here[np.argsort(flat_angles[here], kind="stable")]
            after = np.roll(here, -1)
            turn = (flat_angles[after] - flat_angles[here]) % (2 * math.pi)
            ok = self._free_arcs(circle, flat_angles[here], turn)
            arc = nodes[circle, 2] * turn[ok]
            rows += [here[ok], after[ok] + size]
            columns += [after[ok], here[ok] + size]
            weights += [arc, arc]
        # The two points in which it begins and ends are states of all the lines there.
        source, target = 2 * size, 2 * size + 1
        for circle, rows_of, columns_of in ((count, rows, columns), (count + 1, columns, rows)):
            here = np.nonzero(flat_circles == circle)[0]
            both = np.concatenate([here, here + size])
            rows_of.append(np.full(len(both), source if circle == count else target))
            columns_of.append(both)
            weights.append(np.full(len(both), 1e-12))  # the library drops edges of weight zero
        graph = coo_matrix(
            (np.maximum(np.concatenate(weights), 1e-12), (np.concatenate(rows), np.concatenate(columns))),
            shape=(2 * size + 2, 2 * size + 2),
        ).tocsr()
        totals, before = dijkstra(graph, indices=source, return_predecessors=True)
        if not math.isfinite(totals[target]):
            raise NoPathError(f"no way for the robot from {start} to {goal}")
        chain = [target]
        while chain[-1] != source:
            chain.append(int(before[chain[-1]]))
        return Route(float(totals[target]), self._drawn(chain[-2:0:-1], size, lines, nodes))

    def _drawn(self, chain: List[int], size: int, lines: _Lines, nodes: np.ndarray) -> List[Point]:
        """The states of a path as points, arcs in steps of a degree or two."""
        places, circles, angles = lines.points.reshape(-1, 2), lines.circles.ravel(), lines.angles.ravel()
        points = [tuple(places[chain[0] % size])]
        for state, following in zip(chain, chain[1:]):
            here, there = state % size, following % size
            if here // 2 != there // 2 and circles[here] == circles[there] < len(self._circles):
                sign = 1.0 if state < size else -1.0
                turn = sign * ((sign * (angles[there] - angles[here])) % (2 * math.pi))
                x, y, radius = nodes[circles[here]]
                for part in np.linspace(0.0, 1.0, max(2, math.ceil(abs(turn) / 0.03)))[1:-1]:
                    angle = angles[here] + part * turn
                    points.append((x + radius * math.cos(angle), y + radius * math.sin(angle)))
            points.append(tuple(places[there]))
        return [(float(x), float(y)) for x, y in points]

    def _between(self, pairs: np.ndarray, circles: np.ndarray) -> _Lines:
        """All tangents between pairs of circles; a point is a circle of radius 0."""
        first, second = circles[pairs[:, 0]], circles[pairs[:, 1]]
        offset = second[:, :2] - first[:, :2]
        distance = np.hypot(*offset.T)
        bearing = np.arctan2(offset[:, 1], offset[:, 0])
        found: List[Tuple[np.ndarray, ...]] = []
        for side in (1.0, -1.0):  # the second circle lies on the same side of the line, or on the other
            cosine = (first[:, 2] - side * second[:, 2]) / np.maximum(distance, 1e-12)
            # From a point, both are the same line.
            real = (np.abs(cosine) <= 1.0) & ((side > 0) | (np.minimum(first[:, 2], second[:, 2]) > 0))
            turn = np.arccos(np.clip(cosine[real], -1.0, 1.0))
            for way in (1.0, -1.0):
                angle = bearing[real] + way * turn
                normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
                begin = first[real, :2] + first[real, 2:] * normal
                end = second[real, :2] + side * second[real, 2:] * normal
                other = angle if side > 0 else angle + math.pi
                angles = np.stack([angle, other], axis=1) % (2 * math.pi)
                found.append((pairs[real], angles, np.stack([begin, end], axis=1)))
        return _Lines(*(np.concatenate(parts) for parts in zip(*found)))

    def _free_lines(self, lines: _Lines) -> _Lines:
        if not len(lines.circles):
            return lines
        perhaps = np.ones(len(lines.circles), dtype=bool)
        step = 2 * math.pi / SAMPLES
        for circles, angles in zip(lines.circles.T, lines.angles.T):
            rim = circles < len(self._circles)
            before = np.floor(angles[rim] / step).astype(int) % SAMPLES
            sums = self._blocked[circles[rim]]
            rows = np.arange(len(before))
            perhaps[rim] &= sums[rows, before + 2] - sums[rows, before] < 2  # the samples on both sides
        lines = lines.chosen(perhaps)
        return lines.chosen(self._free(self._outlines.to_lines, lines.points[:, 0], lines.points[:, 1]))

    def _free(self, distances: Callable[..., np.ndarray], *places: np.ndarray) -> np.ndarray:
        """Whether the disc touches nothing there, by the distances of points or of lines."""
        parts = [
            (distances(*(place[i : i + BATCH] for place in places)) >= self._least).all(axis=1)
            for i in range(0, len(places[0]), BATCH)
        ]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=bool)

    def _free_arcs(self, circle: int, begins: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Whether the arcs of a circle from an angle on, counter-clockwise, touch nothing."""
        step = 2 * math.pi / SAMPLES
        # The ends were tested; a rounding error there must not count as blocked.
        first = np.ceil(begins / step + 1e-6).astype(int)
        last = np.floor((begins + turns) / step - 1e-6).astype(int)
        sums = self._blocked[circle]
        clipped = np.minimum(np.maximum(last + 1, first), 2 * SAMPLES)
        return sums[clipped] == sums[np.minimum(first, 2 * SAMPLES)]

    def _outside(self, point: np.ndarray) -> np.ndarray:
        """The nearest point at which the robot can stand."""
        if self._free(self._outlines.to_points, point[None])[0]:
            return point
        turns = np.linspace(0.0, 2 * math.pi, 180, endpoint=False)
        circle = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
        for away in np.geomspace(1e-5, AWAY, 400):
            ring = point + away * circle
            free = self._free(self._outlines.to_points, ring)
            if free.any():
                return ring[np.argmax(free)]
        raise NoPathError(f"the robot cannot stand within {AWAY:g} m of ({point[0]:.2f}, {point[1]:.2f})")


def angle_between(start: float, end: float) -> float:
    """The smaller turn from one heading to another, rad, in (-pi, pi]."""
    return math.pi - (math.pi - (end - start)) % (2 * math.pi)
