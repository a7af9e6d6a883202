# SPDX-License-Identifier: Apache-2.0
"""Recognises the object classes in a picture by colour, shape and size.

A patch of a class's colour is compared with what a thing of that class would look like: standing on each of
the known heights where things stand, or, if it fits nowhere, at the distance at which its size is right. The
best fit wins; its likeness is the score.
"""

import colorsys
import itertools
import math
from typing import Dict, Iterator, List, Optional, Sequence, Tuple

import cv2
import numpy as np

from merlin_reactive.recognition.camera_view import Box, CameraView, area, overlap
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES, ObjectClass
from merlin_reactive.recognition.object_placement import beside, outline, placed, silhouette
from merlin_reactive.recognition.sighting import Sighting

HUE_TOLERANCE = 6  # of OpenCV's 180
DIM = 45  # of 255; darker pixels have no reliable colour
BLACK = 60  # of 255; the dark parts are darker
LEAST_PIXELS = 12  # of a patch
HANGING = 0.8  # a thing that stands on no known height is that much less likely
LEAST_DARK = 0.35  # share of dark pixels where a class has its dark part
FLAT = 0.03  # m; lower things do not hide each other
CHIP = 0.2  # of the largest part of a flat thing; smaller ones are not things
GAP = 61  # pixels of a flat thing that another may hide
LEAST_SEEN = 0.25  # share of its rectangle that a flat thing has to fill although others hide a part of it
DOUBTFUL = 0.9  # likeness of the rectangles below which a patch may be two things
DARK_COUNTS = 0.15  # likeness that the dark part of a full cup adds
LEAST_HALF = 0.75  # likeness of each of them
LEAST_SHIFT = 3  # pixels between them; less is what rounding does to one
FILLED = 0.75  # share of their rectangles that the patch has to fill
EXPLAINED = 0.9  # share of the patch that they have to make


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


def patches(mask: np.ndarray) -> Iterator[Tuple[Box, np.ndarray]]:
    """Connected regions of a mask: the rectangle around each, and which of its pixels belong to it."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    for label in range(1, count):
        x, y, w, h, pixels = stats[label]
        if pixels >= LEAST_PIXELS:
            shape = labels[y : y + h, x : x + w] == label
            yield (float(x), float(y), float(x + w), float(y + h)), shape


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
        masks = {
            color: color_mask(hsv, hue, 0.75 * saturation)
            for color in self._colors
            for hue, saturation, _ in [hsv_of(color)]
        }
        things = np.bitwise_or.reduce(list(masks.values()))
        for color, kinds in self._colors.items():
            if kinds[0].height < FLAT:
                found += self._flat(kinds, masks[color], _joined(masks[color], things), view, dark)
            else:
                for box, shape in patches(masks[color]):
                    found += self._upright(kinds, box, shape, view, dark)
        return found

    def _flat(
        self,
        kinds: List[ObjectClass],
        mask: np.ndarray,
        joined: np.ndarray,
        view: CameraView,
        dark: np.ndarray,
    ) -> List[Sighting]:
        """Things that hide nothing of each other, and of which others hide a part."""
        found = []
        for box, _ in patches(joined):
            left, top, right, bottom = map(int, box)
            seen = np.count_nonzero(mask[top:bottom, left:right])
            enough = seen >= LEAST_PIXELS and seen > LEAST_SEEN * area(box)
            whole = self._best(kinds, box, view, dark) if enough else None
            parts: List[Sighting] = []
            if whole is None or whole.score < DOUBTFUL:
                # What is joined may be a thing and a bit of what stands next to it.
                pieces = [piece for piece, _ in patches(mask[top:bottom, left:right])]
                largest = max(map(area, pieces), default=0.0)
                for x0, y0, x1, y1 in pieces:
                    part = self._best(kinds, (x0 + left, y0 + top, x1 + left, y1 + top), view, dark)
                    if part is not None and area(part.box) > CHIP * largest:
                        parts.append(part)
            least = whole.score if whole is not None else 0.0
            better = [part for part in parts if part.score > least]
            found += better or ([whole] if whole is not None else [])
        return found

    def _upright(
        self, kinds: List[ObjectClass], box: Box, shape: np.ndarray, view: CameraView, dark: np.ndarray
    ) -> List[Sighting]:
        """The one thing, or the two, that a patch shows."""
        whole = self._best(kinds, box, view, dark)
        stands = whole is not None and whole.depth_from == "support"
        if whole is not None and stands and _likeness(whole, view) >= DOUBTFUL:
            return [whole]
        ways = itertools.product(self._supports, ((0, 2), (3, 1)))
        pair = max((_pair(kinds, box, shape, view, dark, *way) for way in ways), key=_least_score)
        if whole is None:
            return pair
        if not pair or (stands and _least_score(pair) <= whole.score):
            return [whole]
        # One thing may have the rectangle of two; but where they would meet, its outline has no step.
        singles = [whole, self._best(kinds, box, view, dark, [None])]
        one = max(_explains([single], box, shape, view) for single in singles if single is not None)
        return pair if _explains(pair, box, shape, view) > one else [whole]

    def _best(
        self,
        kinds: List[ObjectClass],
        box: Box,
        view: CameraView,
        dark: np.ndarray,
        heights: Optional[Sequence[Optional[float]]] = None,
    ) -> Optional[Sighting]:
        """The thing that fits a rectangle best.

        :param heights: of what it may stand on, m; None among them: it may hang anywhere.
        """
        heights = [*self._supports, None] if heights is None else heights
        fits = [self._whole(kind, box, view, dark, heights) for kind in kinds]
        return max((fit for fit in fits if fit is not None), key=lambda fit: fit.score, default=None)

    def _whole(
        self,
        kind: ObjectClass,
        box: Box,
        view: CameraView,
        dark: np.ndarray,
        heights: Sequence[Optional[float]],
    ) -> Optional[Sighting]:
        likeness, place, support = 0.0, None, None
        for height in heights:
            # The bottom may be hidden or outside the picture, or the top.
            for edge, yaw in itertools.product((3, 1), kind.headings):
                here = placed(kind, box, view, height, edge, yaw)
                if here is None:
                    continue
                like = overlap(view.box(outline(kind, here, yaw=yaw)), box)
                like *= HANGING if height is None else 1.0
                if like > likeness + 0.01:
                    likeness, place, support = like, here, height
        if place is None:
            return None
        likeness *= _darkness(kind, place, view, dark)
        return _sighting(kind, likeness, place, box, view, support)


def _pair(
    kinds: List[ObjectClass],
    box: Box,
    shape: np.ndarray,
    view: CameraView,
    dark: np.ndarray,
    height: float,
    sides: Tuple[int, int],
) -> List[Sighting]:
    """The two things on one level that make a patch together; empty when it is not two.

    :param shape: the patch's pixels within its rectangle.
    :param height: of what they stand on, m.
    :param sides: of the rectangle that they make: 0 left, 1 top, 2 right, 3 bottom.
    """
    pair = []
    covered = np.zeros_like(shape)
    for side in sides:
        fits = []
        for kind in kinds:
            for yaw in kind.headings:
                half = beside(kind, box, shape, view, height, side, yaw)
                if half is not None and _within(half[2], box):
                    place, part, expected = half
                    likeness = overlap(expected, part) * _darkness(kind, place, view, dark)
                    fits.append((likeness, kind, place, expected))
        if not fits:
            return []
        likeness, kind, place, expected = max(fits, key=lambda fit: fit[0])
        if likeness < LEAST_HALF:
            return []
        pair.append(_sighting(kind, likeness, place, expected, view, height))
        left, top = max(0, round(expected[0] - box[0])), max(0, round(expected[1] - box[1]))
        covered[top : round(expected[3] - box[1]), left : round(expected[2] - box[0])] = True
    apart = pair[0].distance(pair[1]) > 0.7 * pair[0].size[0] and any(
        abs(one - two) > LEAST_SHIFT for one, two in zip(pair[0].box, pair[1].box)
    )
    both = (shape & covered).sum()
    return pair if apart and both > EXPLAINED * shape.sum() and both > FILLED * covered.sum() else []


def _joined(mask: np.ndarray, things: np.ndarray) -> np.ndarray:
    """A mask without the gaps that other things leave which stand before it."""
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((1, GAP), np.uint8))
    return cv2.bitwise_or(mask, cv2.bitwise_and(closed, things))


def _within(inner: Box, outer: Box) -> bool:
    slack = 1.5 + 0.1 * (inner[3] - inner[1])  # pixels
    return all(inner[i] > outer[i] - slack and inner[i + 2] < outer[i + 2] + slack for i in (0, 1))


def _likeness(sighting: Sighting, view: CameraView) -> float:
    """Overlap of the patch's rectangle with the thing's; a dark part at its place counts too."""
    like = overlap(view.box(_points(sighting, view)), sighting.box)
    return like + (DARK_COUNTS if OBJECT_CLASSES[sighting.name].dark_height else 0.0)


def _points(sighting: Sighting, view: CameraView) -> np.ndarray:
    """Around a thing that was seen; a box at the heading that fits best."""
    kind = OBJECT_CLASSES[sighting.name]
    place = np.array(sighting.position) - (0.0, 0.0, sighting.size[2] / 2)
    return max(
        (outline(kind, place, yaw=yaw) for yaw in kind.headings),
        key=lambda points: overlap(view.box(points), sighting.box),
    )


def _explains(things: Sequence[Sighting], box: Box, shape: np.ndarray, view: CameraView) -> float:
    """How well the outlines of things, seen as one, fit a patch, 0..1."""
    rim = math.ceil(max(shape.shape) / 4)
    window = (box[0] - rim, box[1] - rim, box[2] + rim, box[3] + rim)
    seen = np.pad(shape, rim)
    shown = np.bitwise_or.reduce([silhouette(view, _points(thing, view), window) for thing in things])
    return float((seen & shown).sum() / (seen | shown).sum())


def _least_score(sightings: List[Sighting]) -> float:
    return min((sighting.score for sighting in sightings), default=0.0)


def _sighting(
    kind: ObjectClass,
    likeness: float,
    place: np.ndarray,
    box: Box,
    view: CameraView,
    support: Optional[float],
) -> Sighting:
    """:param place: where its bottom's middle is, m; :param support: height that this follows from."""
    middle = place + (0.0, 0.0, kind.height / 2)
    size = kind.footprint
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


def _darkness(kind: ObjectClass, place: np.ndarray, view: CameraView, dark: np.ndarray) -> float:
    """How well the dark pixels fit a class, 0..1."""
    if kind.dark_height:
        share = _share(
            dark, view.box(outline(kind, place, kind.height * (1.0 - kind.dark_height), kind.height))
        )
        return share if share > LEAST_DARK else 0.0
    if kind.dark_radius:
        share = _share(dark, _inner(kind, place, view, kind.dark_radius))
        return 1.0 if share > LEAST_DARK else 0.0
    if not any(other.color == kind.color and other is not kind for other in OBJECT_CLASSES.values()):
        return 1.0
    return 0.0 if _share(dark, _inner(kind, place, view, 0.6)) > LEAST_DARK else 1.0


def _inner(kind: ObjectClass, place: np.ndarray, view: CameraView, share: float) -> Optional[Box]:
    """The rectangle around the middle of a thing's top."""
    top = outline(kind, place, kind.height, kind.height)
    middle = place + (0.0, 0.0, kind.height)
    return view.box(middle + (top - middle) * share)


def _share(mask: np.ndarray, box: Optional[Box]) -> float:
    if box is None:
        return 0.0
    left, top, right, bottom = (round(edge) for edge in box)
    part = mask[top : max(bottom, top + 1), left : max(right, left + 1)]
    return float(part.mean()) if part.size else 0.0
