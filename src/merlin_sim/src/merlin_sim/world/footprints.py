# SPDX-License-Identifier: Apache-2.0
"""Whether two things would be in the same place."""

from typing import List, Sequence

from merlin_reactive.pose import Point
from merlin_sim.world.world_model import Solid

TOUCHING = 2e-5  # m² that two outlines may share: things may stand side by side
STACKED = 0.002  # m, likewise in height


def collide(one: Solid, other: Solid, one_bottom: float = 0.0, other_bottom: float = 0.0) -> bool:
    """Whether two things share space; their lower ends are so many m above the floor."""
    if (
        one_bottom + one.height <= other_bottom + STACKED
        or other_bottom + other.height <= one_bottom + STACKED
    ):
        return False
    return shared_area(one.corners(), other.corners()) > TOUCHING


def shared_area(one: Sequence[Point], other: Sequence[Point]) -> float:
    """The area that two convex polygons have in common, m².

    :param one: corners, counter-clockwise.
    :param other: likewise.
    """
    left: List[Point] = list(one)
    for index, begin in enumerate(other):
        left = _left_of(left, other[index - 1], begin)
    return sum(_cross(left[0], before, corner) for before, corner in zip(left[1:], left[2:])) / 2


def _left_of(polygon: Sequence[Point], begin: Point, end: Point) -> List[Point]:
    """What of a convex polygon lies on the left of a line."""
    kept: List[Point] = []
    sides = [_cross(begin, end, corner) for corner in polygon]
    for index, corner in enumerate(polygon):
        before, side, side_before = polygon[index - 1], sides[index], sides[index - 1]
        if side * side_before < 0.0:
            part = side_before / (side_before - side)
            kept.append(
                (before[0] + part * (corner[0] - before[0]), before[1] + part * (corner[1] - before[1]))
            )
        if side >= 0.0:
            kept.append(corner)
    return kept


def _cross(origin: Point, one: Point, other: Point) -> float:
    """Twice the area of a triangle, negative when it is clockwise."""
    return (one[0] - origin[0]) * (other[1] - origin[1]) - (one[1] - origin[1]) * (other[0] - origin[0])
