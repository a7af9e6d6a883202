# SPDX-License-Identifier: Apache-2.0
"""The obstacles of a place as exact shapes: what the oracle's robot must not touch.

A shape is a convex polygon grown by a radius: a box is four corners, an upright cylinder one corner and its
radius. No raster is involved, so distances are exact.
"""

from dataclasses import dataclass
from typing import Iterable, List, Tuple

import numpy as np

from merlin_sim.world.world_model import DoorEvent, MoveEvent, Solid, World

Point = Tuple[float, float]


@dataclass(frozen=True)
class Outline:
    """A convex polygon grown by a radius.

    :ivar corners: counter-clockwise, m; one: a disc, two: a rod.
    :ivar radius: m.
    """

    corners: Tuple[Point, ...]
    radius: float = 0.0


class Outlines:
    """Shapes with their distances to many points or lines at once."""

    def __init__(self, shapes: Iterable[Outline]) -> None:
        self.shapes = list(shapes)
        self.radii = np.array([shape.radius for shape in self.shapes], dtype=float)
        starts: List[Point] = []
        ends: List[Point] = []
        counts: List[int] = []
        for shape in self.shapes:
            starts += shape.corners
            ends += shape.corners[1:] + shape.corners[:1]
            counts.append(len(shape.corners))
        self._starts = np.array(starts, dtype=float).reshape(-1, 2)
        self._ends = np.array(ends, dtype=float).reshape(-1, 2)
        self._firsts = np.concatenate([[0], np.cumsum(counts[:-1])]).astype(int)
        self._area = np.array(counts) >= 3

    def to_points(self, points: np.ndarray) -> np.ndarray:
        """Distances of points (n x 2, m) from the shapes, m: n x shapes, negative inside a grown rim."""
        if not self.shapes:
            return np.zeros((len(points), 0))
        gaps = _point_to_segment(points[:, None], self._starts[None], self._ends[None])
        nearest = np.minimum.reduceat(gaps, self._firsts, axis=1)
        nearest[self._inside(points)] = 0.0
        return nearest - self.radii

    def to_lines(self, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Distances of straight lines between points (n x 2 each, m) from the shapes, m: n x shapes."""
        if not self.shapes:
            return np.zeros((len(starts), 0))
        a, b = starts[:, None], ends[:, None]
        c, d = self._starts[None], self._ends[None]
        ends_apart = ((a, c, d), (b, c, d), (c, a, b), (d, a, b))
        gaps = np.minimum.reduce([_point_to_segment(*each) for each in ends_apart])
        sides = _cross(b - a, c - a) * _cross(b - a, d - a) < 0
        gaps[sides & (_cross(d - c, a - c) * _cross(d - c, b - c) < 0)] = 0.0
        nearest = np.minimum.reduceat(gaps, self._firsts, axis=1)
        nearest[self._inside(starts)] = 0.0
        return nearest - self.radii

    def _inside(self, points: np.ndarray) -> np.ndarray:
        left = _cross((self._ends - self._starts)[None], points[:, None] - self._starts[None]) >= 0
        return np.logical_and.reduceat(left, self._firsts, axis=1) & self._area


def outlines_of_world(world: World) -> Outlines:
    """The parts of a world that never move: walls, and furniture that is not pushed or moved.

    Doors count as long as they never open; people, things with a mass and what is moved by an event do not
    count: a yardstick may have it too easy, never too hard.
    """
    moved = {event.thing for event in world.events if isinstance(event, MoveEvent)}
    opened = {event.door for event in world.events if isinstance(event, DoorEvent) and event.open}
    solids = world.wall_solids()
    solids += [
        thing
        for thing in [*world.furniture, *world.unmapped]
        if thing.mass == 0.0 and thing.name not in moved
    ]
    solids += [
        door.leaf(world.wall_thickness, world.wall_height)
        for door in world.doors
        if not door.open and door.name not in opened
    ]
    return Outlines(_outline(solid) for solid in solids)


def outlines_of_map(occupied: np.ndarray, resolution: float, origin: Point) -> Outlines:
    """What a map says for certain: there is an obstacle at the centre of each occupied cell.

    The squares of the cells reach up to half a cell beyond the true obstacle, and would make the yardstick
    too hard. No disc wider than a cell passes between neighbouring centres.

    :param occupied: row = y, column = x.
    :param resolution: edge of a cell, m.
    :param origin: map coordinates of the outer corner of cell (0, 0), m.
    """
    shapes = []
    for first_row, last_row, first, last in _rectangles(occupied):
        left, right = (origin[0] + (column + 0.5) * resolution for column in (first, last))
        low, high = (origin[1] + (row + 0.5) * resolution for row in (first_row, last_row))
        corners = dict.fromkeys([(left, low), (right, low), (right, high), (left, high)])
        shapes.append(Outline(tuple(corners)))
    return Outlines(shapes)


def _outline(solid: Solid) -> Outline:
    if solid.radius is not None:
        return Outline((solid.pose.point,), solid.radius)
    return Outline(tuple(solid.corners()))


def _rectangles(occupied: np.ndarray) -> List[Tuple[int, int, int, int]]:
    """Rectangles that cover the occupied cells: first and last row, first and last column."""
    left = occupied.astype(bool).copy()
    found = []
    for row, column in np.argwhere(occupied):
        if not left[row, column]:
            continue
        last = column
        while last + 1 < occupied.shape[1] and occupied[row, last + 1]:
            last += 1
        first = column
        while first > 0 and occupied[row, first - 1]:
            first -= 1
        bottom = top = row
        while top + 1 < len(occupied) and occupied[top + 1, first : last + 1].all():
            top += 1
        while bottom > 0 and occupied[bottom - 1, first : last + 1].all():
            bottom -= 1
        left[bottom : top + 1, first : last + 1] = False
        found.append((int(bottom), int(top), int(first), int(last)))
    return found


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _point_to_segment(points: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    along = ends - starts
    square = (along**2).sum(axis=-1)
    part = ((points - starts) * along).sum(axis=-1) / np.where(square > 0, square, 1.0)
    offset = points - starts - np.clip(part, 0.0, 1.0)[..., None] * along
    return np.hypot(offset[..., 0], offset[..., 1])
