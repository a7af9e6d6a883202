"""Recognises the classes of :mod:`merlin_sim.object_classes` in a picture by colour, shape and size.

A patch of a class's colour is compared with what a thing of that class would look like: standing on each of
the known heights where things stand, or, if it fits nowhere, at the distance at which its size is right. The
best fit wins; its likeness is the score.
"""

import colorsys
import math
from typing import Dict, List, Optional, Sequence, Tuple

import cv2
import numpy as np

from merlin_sim.camera_view import Box, CameraView, area, overlap
from merlin_sim.object_classes import OBJECT_CLASSES, ObjectClass
from merlin_sim.sighting import Sighting

HUE_TOLERANCE = 6  # of OpenCV's 180
DIM = 45  # of 255; darker pixels have no reliable colour
BLACK = 60  # of 255; the dark parts are darker
LEAST_PIXELS = 12  # of a patch
HANGING = 0.8  # a thing that stands on no known height is that much less likely
LEAST_DARK = 0.35  # share of dark pixels where a class has its dark part
_RING = np.linspace(0.0, 2 * math.pi, 16, endpoint=False)


def hsv_of(color: str) -> Tuple[int, int, int]:
    """A colour `#rrggbb` in OpenCV's HSV: 0..179, 0..255, 0..255."""
    red, green, blue = (int(color[index : index + 2], 16) / 255 for index in (1, 3, 5))
    hue, saturation, value = colorsys.rgb_to_hsv(red, green, blue)
    return round(hue * 180) % 180, round(saturation * 255), round(value * 255)


def color_mask(hsv: np.ndarray, hue: int, low: float, high: float = 255.0) -> np.ndarray:
    """Pixels of a hue whose saturation lies within low..high (of 255), as 0 and 255."""
    first, last = hue - HUE_TOLERANCE, hue + HUE_TOLERANCE
    spans = [(max(first, 0), min(last, 179))]
    if first < 0:
        spans.append((first + 180, 179))
    if last > 179:
        spans.append((0, last - 180))
    masks = [cv2.inRange(hsv, (a, low, DIM), (b, high, 255)) for a, b in spans]
    return masks[0] if len(masks) == 1 else cv2.bitwise_or(masks[0], masks[1])


def patches(mask: np.ndarray, least: int = LEAST_PIXELS) -> List[Tuple[Box, int]]:
    """Connected regions of a mask: the rectangle around each, and its pixels."""
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return [
        ((float(x), float(y), float(x + w), float(y + h)), int(pixels))
        for x, y, w, h, pixels in stats[1:count]
        if pixels >= least
    ]


class ObjectDetector:
    """Looks for things.

    :param supports: heights above the floor on which things stand, m.
    """

    def __init__(self, supports: Sequence[float]) -> None:
        self._supports = list(supports)
        self._colors: Dict[str, List[ObjectClass]] = {}
        for kind in OBJECT_CLASSES.values():
            self._colors.setdefault(kind.color, []).append(kind)

    def detect(self, picture: np.ndarray, view: CameraView) -> List[Sighting]:
        """What stands in a picture (height x width x 3, RGB, 0..255)."""
        hsv = cv2.cvtColor(picture, cv2.COLOR_RGB2HSV)
        dark = hsv[:, :, 2] < BLACK
        found = []
        for color, kinds in self._colors.items():
            hue, saturation, _ = hsv_of(color)
            for box, _ in patches(color_mask(hsv, hue, 0.75 * saturation)):
                fits = [self._best(kind, box, view, dark) for kind in kinds]
                best = max((fit for fit in fits if fit is not None), key=lambda fit: fit.score, default=None)
                if best is not None:
                    found.append(best)
        return found

    def _best(self, kind: ObjectClass, box: Box, view: CameraView, dark: np.ndarray) -> Optional[Sighting]:
        likeness, place, support = 0.0, None, None
        for height in [*self._supports, None]:
            for edge in (3, 1):  # the bottom may be hidden or outside the picture, or the top
                here = _placed(kind, box, view, height, edge)
                if here is None:
                    continue
                like = overlap(view.box(_outline(kind, here)), box) * (HANGING if height is None else 1.0)
                if like > likeness + 0.01:
                    likeness, place, support = like, here, height
        if place is None:
            return None
        likeness *= _darkness(kind, place, view, dark)
        middle = place + (0.0, 0.0, kind.height / 2)
        size = kind.size or (2 * kind.radius, 2 * kind.radius)
        distance = float(np.linalg.norm(middle - view.position))
        pixel = distance / view.matrix[0, 0]  # m across a pixel
        drop = max(view.position[2] - place[2], 0.05)
        # By a plane, an error of a pixel counts more the flatter the ray; by size, the smaller the thing.
        along = pixel * distance / drop if support is not None else distance / math.sqrt(area(box))
        return Sighting(
            kind.name,
            likeness,
            tuple(middle.tolist()),
            (size[0], size[1], kind.height),
            box,
            spread=math.hypot(along, pixel),
            depth_from="size" if support is None else "support",
        )


def _outline(kind: ObjectClass, bottom: np.ndarray, low: float = 0.0, high: float = -1.0) -> np.ndarray:
    """Points around a thing between two heights above its bottom, m; without them: around what has colour."""
    if high < 0.0:
        high = kind.height * (1.0 - kind.dark_height)
    radius = kind.width / 2
    ring = np.stack([radius * np.cos(_RING), radius * np.sin(_RING), np.zeros_like(_RING)], axis=1)
    return np.concatenate([ring + bottom + (0.0, 0.0, low), ring + bottom + (0.0, 0.0, high)])


def _placed(
    kind: ObjectClass, box: Box, view: CameraView, height: Optional[float], edge: int
) -> Optional[np.ndarray]:
    """Where a thing stands (its bottom's middle) that appears in the middle of a rectangle.

    :param height: of what it stands on; None: it may hang anywhere.
    :param edge: of the rectangle that it appears at too: 1 the top, 3 the bottom.
    """
    u, v = (box[0] + box[2]) / 2 - 0.5, (box[1] + box[3]) / 2 - 0.5
    distance = view.matrix[0, 0] * kind.width / (box[2] - box[0])
    for _ in range(5):
        if height is None:
            place = view.position + distance * view.ray(u, v) - (0.0, 0.0, kind.height / 2)
        else:
            place = view.on_plane(u, v, height)
        pixels = None if place is None else view.project(_outline(kind, place))
        if pixels is None:
            return None
        (left, top), (right, bottom) = pixels.min(axis=0) + 0.5, pixels.max(axis=0) + 0.5
        u += (box[0] + box[2]) / 2 - (left + right) / 2
        if height is None:
            v += (box[1] + box[3]) / 2 - (top + bottom) / 2
            distance *= math.sqrt((right - left) * (bottom - top) / area(box))
        else:
            v += box[edge] - (left, top, right, bottom)[edge]
    return place


def _darkness(kind: ObjectClass, place: np.ndarray, view: CameraView, dark: np.ndarray) -> float:
    """How well the dark pixels fit a class, 0..1."""
    if kind.dark_height:
        share = _share(
            dark, view.box(_outline(kind, place, kind.height * (1.0 - kind.dark_height), kind.height))
        )
        return share if share > LEAST_DARK else 0.0
    if kind.dark_radius:
        share = _share(dark, _inner(kind, place, view, kind.dark_radius))
        return 1.0 if share > LEAST_DARK else 0.0
    if not _has_dark_sibling(kind):
        return 1.0
    return 0.0 if _share(dark, _inner(kind, place, view, 0.6)) > LEAST_DARK else 1.0


def _has_dark_sibling(kind: ObjectClass) -> bool:
    return any(other.color == kind.color and other is not kind for other in OBJECT_CLASSES.values())


def _inner(kind: ObjectClass, place: np.ndarray, view: CameraView, share: float) -> Optional[Box]:
    """The rectangle around the middle of a thing's top."""
    top = _outline(kind, place, kind.height, kind.height)
    middle = place + (0.0, 0.0, kind.height)
    return view.box(middle + (top - middle) * share)


def _share(mask: np.ndarray, box: Optional[Box]) -> float:
    if box is None:
        return 0.0
    left, top, right, bottom = (round(edge) for edge in box)
    part = mask[top : max(bottom, top + 1), left : max(right, left + 1)]
    return float(part.mean()) if part.size else 0.0
