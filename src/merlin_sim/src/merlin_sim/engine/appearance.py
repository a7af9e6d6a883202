"""What things look like to the camera: the one place that gives a body its visual shape.

Visual shapes are made with the body and cost nothing in a physics step; only a picture looks at them.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Dict, List, Optional, Sequence, Tuple

from merlin_reactive.recognition.object_classes import (
    DARK,
    HEAD_RADIUS,
    OBJECT_CLASSES,
    PERSON,
    SHOULDERS,
    SKIN,
)
from merlin_sim.engine.muted_output import muted_output
from merlin_sim.engine.tag_card import CARD, write_cards
from merlin_sim.world.world_model import Solid

with muted_output():
    import pybullet

WALL = "wall"
WALL_PAINT = "#d8d2c4"
FLOOR_PAINT = "#a8a294"
SMEAR = 0.003  # m that what is left on a plate rises above it

Color = Tuple[float, float, float]


class Appearance:
    """Makes visual shapes for one physics engine.

    :param engine: a BulletClient.
    """

    def __init__(self, engine: Any) -> None:
        self._engine = engine
        self._folder: Optional[TemporaryDirectory] = None  # of the tags' files, which bodies are made from

    def close(self) -> None:
        """Removes the files that were written for the engine."""
        if self._folder is not None:
            self._folder.cleanup()

    def of(self, solid: Solid, kind: str = "", tag: Optional[int] = None) -> int:
        """The visual shape of a thing, around its middle.

        :param kind: `wall`, `person`, a class of `object_classes`, or anything else: then it
            has its own shape and colour.
        :param tag: number of the ArUco tag on its four sides.
        """
        parts = _parts(solid, kind)
        if tag is not None:
            parts.append(_Part(pybullet.GEOM_MESH, file=self._cards(solid, tag)))
        return self._compound(parts)

    def _cards(self, solid: Solid, tag: int) -> str:
        if self._folder is None:
            self._folder = TemporaryDirectory(prefix="merlin_tags_")
        # The card of a thing lower than itself stands on the same ground.
        rise = max(0.0, CARD / 2 - solid.height / 2)
        return write_cards(Path(self._folder.name), solid.name, tag, solid.half_size, rise)

    def floor(self, bounds: Tuple[float, float, float, float]) -> int:
        """The visual shape of the ground under a rectangle: min x, min y, max x, max y, m."""
        left, bottom, right, top = bounds
        slab = _Part(
            pybullet.GEOM_BOX,
            color=rgb(FLOOR_PAINT),
            half=((right - left) / 2 + 1.0, (top - bottom) / 2 + 1.0, 0.01),
            at=((left + right) / 2, (bottom + top) / 2, -0.01),
        )
        return self._compound([slab])

    def _compound(self, parts: Sequence["_Part"]) -> int:
        fields: Dict[str, List[Any]] = {
            "shapeTypes": [part.shape for part in parts],
            "halfExtents": [part.half for part in parts],
            "radii": [part.radius for part in parts],
            "lengths": [part.length for part in parts],
            "fileNames": [part.file for part in parts],
            "meshScales": [(1.0, 1.0, 1.0) for _ in parts],
            "visualFramePositions": [part.at for part in parts],
            "rgbaColors": [(*part.color, 1.0) for part in parts],
        }
        with muted_output():  # the engine tells of every file that it reads
            return int(self._engine.createVisualShapeArray(**fields))


class _Part:
    """One shape of several that make a thing; unused fields have values the engine does not mind."""

    def __init__(
        self,
        shape: int,
        color: Color = (1.0, 1.0, 1.0),
        half: Tuple[float, float, float] = (1.0, 1.0, 1.0),
        radius: float = 1.0,
        length: float = 1.0,
        at: Tuple[float, float, float] = (0.0, 0.0, 0.0),
        file: str = "",
    ) -> None:
        self.shape, self.color, self.half, self.radius = shape, color, half, radius
        self.length, self.at, self.file = length, at, file


def rgb(color: str) -> Color:
    """Red, green and blue, 0..1, of `#rrggbb`."""
    return tuple(int(color[index : index + 2], 16) / 255 for index in (1, 3, 5))  # type: ignore[return-value]


def _parts(solid: Solid, kind: str) -> List[_Part]:
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


def _slice(solid: Solid, color: str, low: float, high: float, share: float = 1.0) -> _Part:
    """The part of a solid between two heights above its bottom, m; `share` of its width."""
    at = (0.0, 0.0, (low + high) / 2 - solid.height / 2)
    if solid.radius is not None:
        return _Part(
            pybullet.GEOM_CYLINDER, rgb(color), radius=solid.radius * share, length=high - low, at=at
        )
    assert solid.size is not None
    half = (solid.size[0] / 2 * share, solid.size[1] / 2 * share, (high - low) / 2)
    return _Part(pybullet.GEOM_BOX, rgb(color), half=half, at=at)


def _person(solid: Solid) -> List[_Part]:
    shoulders = min(SHOULDERS, solid.height - 2 * HEAD_RADIUS)
    head = _Part(
        pybullet.GEOM_SPHERE,
        rgb(SKIN),
        radius=HEAD_RADIUS,
        at=(0.0, 0.0, solid.height / 2 - HEAD_RADIUS),
    )
    return [_slice(solid, solid.color, 0.0, shoulders), head]
