# SPDX-License-Identifier: Apache-2.0
"""The classes of things that can be recognised: how big each is and what it looks like.

Both sides read this table: the renderer paints things after it, the detector looks for them. A real robot's
detector brings its own.
"""

import math
from dataclasses import dataclass
from typing import Dict, Optional, Sequence, Tuple

PERSON = "person"
TAG = "tag"  # followed by _ and its number in results
PERSON_RADIUS = 0.22  # m, of the body
PERSON_HEIGHT = 1.7  # m
SEAT = 0.45  # m by which a sitting person is shorter
SHOULDERS = 1.44  # m above the floor: the body ends here
HEAD_RADIUS = 0.13  # m
CLOTHES = "#b04a7a"
SKIN = "#e6b48c"
HEADING_STEP = math.radians(15.0)  # a box looks the same within half of it
DARK = "#140c08"  # coffee, and what is left on a plate


@dataclass(frozen=True)
class ObjectClass:
    """A class of objects that all look the same.

    Upright cylinders (radius, height) or boxes (size, height); m.

    :param color: of the whole, or of what the dark part leaves.
    :param dark_height: share of the height, from the top, that is dark: a full cup.
    :param dark_radius: share of the radius that is dark on the top: a used plate.
    """

    name: str
    color: str
    height: float
    radius: Optional[float] = None
    size: Optional[Tuple[float, float]] = None
    dark_height: float = 0.0
    dark_radius: float = 0.0

    @property
    def footprint(self) -> Tuple[float, float]:
        """Its extent along its own x and y axes, m."""
        if self.radius is not None:
            return 2 * self.radius, 2 * self.radius
        assert self.size is not None, f"{self.name} has neither a size nor a radius"
        return self.size

    @property
    def width(self) -> float:
        """How wide it appears from the side, m; for a box the mean over all sides."""
        if self.radius is not None:
            return 2 * self.radius
        return sum(self.footprint) * 0.6366  # 2/pi: the mean of |cos| over all headings

    @property
    def headings(self) -> Tuple[float, ...]:
        """The yaw angles at which it can look different, rad; a cylinder has one."""
        if self.size is None:
            return (0.0,)
        turn = math.pi / 2 if self.size[0] == self.size[1] else math.pi
        count = round(turn / HEADING_STEP)
        return tuple(turn * index / count for index in range(count))


_CUP, _GLASS, _PLATE = (0.04, 0.10), (0.035, 0.13), (0.11, 0.02)

OBJECT_CLASSES: Dict[str, ObjectClass] = {
    item.name: item
    for item in (
        ObjectClass("cup", "#d01818", _CUP[1], _CUP[0]),  # an empty cup
        ObjectClass("coffee", "#d01818", _CUP[1], _CUP[0], dark_height=0.4),  # a full cup
        ObjectClass("glass", "#20d0d0", _GLASS[1], _GLASS[0]),  # an empty glass
        ObjectClass("water", "#1830d0", _GLASS[1], _GLASS[0]),  # a glass of water
        ObjectClass("juice", "#f08000", _GLASS[1], _GLASS[0]),  # a glass of orange juice
        ObjectClass("bottle", "#18a018", 0.25, 0.04),  # a bottle
        ObjectClass("can", "#e0c010", 0.12, 0.033),  # a can
        ObjectClass("plate", "#8020d8", _PLATE[1], _PLATE[0]),  # a clean plate
        ObjectClass("dirty_plate", "#8020d8", _PLATE[1], _PLATE[0], dark_radius=0.7),  # a used plate
        ObjectClass("sandwich", "#98e010", 0.05, size=(0.12, 0.12)),  # a sandwich
        ObjectClass("cake", "#f01898", 0.08, 0.07),  # a small cake
    )
}
TAGS = frozenset(f"{TAG}_{number}" for number in range(50))


def unknown_classes(classes: Sequence[str]) -> str:
    """What is wrong with names of classes, naming the known ones; empty: all are known."""
    known = [*OBJECT_CLASSES, PERSON, TAG]
    unknown = [name for name in classes if name not in known and name not in TAGS]
    return f"unknown class {unknown[0]!r}; known: {', '.join(known)}, {TAG}_0 to {TAG}_49" if unknown else ""
