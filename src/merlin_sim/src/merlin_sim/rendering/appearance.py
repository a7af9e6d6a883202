# SPDX-License-Identifier: Apache-2.0
"""What things look like to the camera: the one place that gives a body its shapes and colours.

Nothing here draws: :mod:`merlin_sim.rendering.picture_engine` does.
"""

import math
from dataclasses import dataclass
from enum import Enum, auto
from typing import List, Optional, Tuple

from merlin_reactive.recognition.object_classes import (
    DARK,
    HEAD_RADIUS,
    OBJECT_CLASSES,
    PERSON,
    SHOULDERS,
    SKIN,
)
from merlin_sim.world.world_model import Solid

WALL = "wall"
WALL_PAINT = "#d8d2c4"
FLOOR_PAINT = "#a8a294"
FLOOR_EDGE = 1.0  # m of floor beyond what the world says
SMEAR = 0.003  # m that what is left on a plate rises above it
CARD = 0.14  # m, edge of the white card around a tag
GAP = 0.002  # m between a thing and its cards

Color = Tuple[float, float, float]
Vector = Tuple[float, float, float]
Quaternion = Tuple[float, float, float, float]  # x, y, z, w


class Shape(Enum):
    """The shapes of parts, around their middle; each one fills a box of the part's size."""

    BOX = auto()
    CYLINDER = auto()  # upright
    SPHERE = auto()
    RECTANGLE = auto()  # flat, seen from above
    MESH = auto()  # of a file; the size is a factor


@dataclass(frozen=True)
class Part:
    """One shape of those that make a body.

    :param size: along its own x, y and z, m.
    :param at, turn: where it is in the body's frame.
    :param color: red, green and blue, 0..1.
    :param file: of a mesh.
    :param tag: number of the ArUco tag that a rectangle shows.
    """

    shape: Shape
    size: Vector
    color: Color = (1.0, 1.0, 1.0)
    at: Vector = (0.0, 0.0, 0.0)
    turn: Quaternion = (0.0, 0.0, 0.0, 1.0)
    file: str = ""
    tag: Optional[int] = None


Parts = Tuple[Part, ...]


def parts_of(solid: Solid, kind: str = "", tag: Optional[int] = None) -> Parts:
    """The parts of a thing, around its middle.

    :param kind: `wall`, `person`, a class of `object_classes`, or anything else: then it has its own
        shape and colour.
    :param tag: number of the ArUco tag on its four sides.
    """
    return (*_body(solid, kind), *([] if tag is None else _cards(solid, tag)))


def floor(bounds: Tuple[float, float, float, float]) -> Parts:
    """The ground under a rectangle: min x, min y, max x, max y, m."""
    left, bottom, right, top = bounds
    size = (right - left + 2 * FLOOR_EDGE, top - bottom + 2 * FLOOR_EDGE, 1.0)
    middle = ((left + right) / 2, (bottom + top) / 2, 0.0)
    return (Part(Shape.RECTANGLE, size, rgb(FLOOR_PAINT), middle),)


def rgb(color: str) -> Color:
    """Red, green and blue, 0..1, of `#rrggbb`."""
    return tuple(int(color[index : index + 2], 16) / 255 for index in (1, 3, 5))  # type: ignore[return-value]


def _body(solid: Solid, kind: str) -> List[Part]:
    if kind == PERSON:
        return _person(solid)
    if kind == WALL:
        return [_slice(solid, WALL_PAINT, 0.0, solid.height)]
    known = OBJECT_CLASSES.get(kind)
    if known is None:
        return [_slice(solid, solid.color, 0.0, solid.height)]
    dark_from = solid.height * (1.0 - known.dark_height)
    parts = [_slice(solid, known.color, 0.0, dark_from)]
    if known.dark_height:
        parts.append(_slice(solid, DARK, dark_from, solid.height))
    if known.dark_radius:
        parts.append(_slice(solid, DARK, solid.height / 2, solid.height + SMEAR, known.dark_radius))
    return parts


def _slice(solid: Solid, color: str, low: float, high: float, share: float = 1.0) -> Part:
    """The part of a solid between two heights above its bottom, m; `share` of its width."""
    shape = Shape.BOX if solid.radius is None else Shape.CYLINDER
    width, depth = (2 * half * share for half in solid.half_size)
    at = (0.0, 0.0, (low + high) / 2 - solid.height / 2)
    return Part(shape, (width, depth, high - low), rgb(color), at)


def _person(solid: Solid) -> List[Part]:
    shoulders = min(SHOULDERS, solid.height - 2 * HEAD_RADIUS)
    at = (0.0, 0.0, solid.height / 2 - HEAD_RADIUS)
    head = Part(Shape.SPHERE, (2 * HEAD_RADIUS,) * 3, rgb(SKIN), at)
    return [_slice(solid, solid.color, 0.0, shoulders), head]


def _cards(solid: Solid, tag: int) -> List[Part]:
    """A card on each side of an upright thing."""
    # The card of a thing lower than itself stands on the same ground.
    rise = max(0.0, CARD / 2 - solid.height / 2)
    cards = []
    for quarter in range(4):
        yaw = quarter * math.pi / 2
        away = solid.half_size[quarter % 2] + GAP
        at = (away * round(math.cos(yaw)), away * round(math.sin(yaw)), rise)
        cards.append(Part(Shape.RECTANGLE, (CARD, CARD, 1.0), at=at, turn=_upright(yaw), tag=tag))
    return cards


def _upright(yaw: float) -> Quaternion:
    """Turns a rectangle so that it stands, its upper edge up, and is seen from the direction `yaw`."""
    # The axes change places (x to y, y to z, z to x), and then all turns about the vertical.
    more, less = (math.cos(yaw / 2) + math.sin(yaw / 2)) / 2, (math.cos(yaw / 2) - math.sin(yaw / 2)) / 2
    return (less, more, more, less)
