# SPDX-License-Identifier: Apache-2.0
"""Recognises people by their clothes, their width and their head."""

import math
from typing import List, Optional, Tuple

import cv2
import numpy as np

from merlin_reactive.recognition.camera_view import Box, CameraView, overlap
from merlin_reactive.recognition.object_classes import (
    CLOTHES,
    HEAD_RADIUS,
    PERSON,
    PERSON_HEIGHT,
    PERSON_RADIUS,
    SEAT,
    SHOULDERS,
    SKIN,
)
from merlin_reactive.recognition.object_detector import color_mask, hsv_of, patches
from merlin_reactive.recognition.sighting import Sighting

LEAST_PIXELS = 150
LEAST_WIDTH = 10  # pixels
LEAST_WHOLE = 0.2  # share of a body's rows that the picture's edge must not cut
STANDS = 0.8  # likeness to a person seen down to the feet, above which the distance follows from the feet
_RING = np.linspace(0.0, 2 * math.pi, 24, endpoint=False)


class PersonDetector:
    """Looks for people."""

    def detect(self, picture: np.ndarray, view: CameraView) -> List[Sighting]:
        """The people in a picture (RGB)."""
        hsv = cv2.cvtColor(picture, cv2.COLOR_RGB2HSV)
        hue, saturation, _ = hsv_of(CLOTHES)
        clothes = color_mask(hsv, hue, 0.7 * saturation, 1.25 * saturation)
        skin_hue, skin_saturation, _ = hsv_of(SKIN)
        skin = color_mask(hsv, skin_hue, 0.6 * skin_saturation, 1.15 * skin_saturation) > 0
        found = []
        for box, rows in patches(clothes):
            height, width = rows.shape
            if rows.sum() < LEAST_PIXELS or width < LEAST_WIDTH or height < 0.3 * width:
                continue
            sighting = self._sighting(box, rows, skin, view)
            if sighting is not None:
                found.append(sighting)
        return found

    def _sighting(self, box: Box, rows: np.ndarray, skin: np.ndarray, view: CameraView) -> Optional[Sighting]:
        sides = _sides(rows, box[0] <= 0, box[2] >= view.width)
        place, origin = None, "size"
        # Cut at a side, the rectangle's middle and its bottom are not the body's: where it reaches
        # farthest down may lie outside the picture, and its width counts only where both sides are visible.
        if box[0] > 0 and box[2] < view.width and box[3] < view.height:
            feet = _by_feet(box, view)
            if feet is not None and overlap(view.box(_body(feet)), box) > STANDS:
                place, origin = feet, "support"
        if place is None and sides is not None:
            left, right, row = sides
            place = _by_width((box[0] + (left + right) / 2 - 0.5, box[1] + row), right - left, view)
        if place is None:
            return None
        filled = min(1.0, float(rows.mean()) / 0.9)
        head = _head(place, skin, view)
        if head is not None:  # a sitting person is one too
            head = max(head, _head(place, skin, view, PERSON_HEIGHT - SEAT) or 0.0)
        distance = float(np.linalg.norm(place[:2] - view.position[:2]))
        pixel = distance / view.matrix[0, 0]
        along = pixel * distance / view.position[2] if origin == "support" else distance / (box[2] - box[0])
        return Sighting(
            PERSON,
            filled * (0.4 + 0.6 * head if head is not None else 0.8),
            (float(place[0]), float(place[1]), PERSON_HEIGHT / 2),
            (2 * PERSON_RADIUS, 2 * PERSON_RADIUS, PERSON_HEIGHT),
            box,
            spread=math.hypot(along, pixel),
            depth_from=origin,
        )


def _sides(rows: np.ndarray, cut_left: bool, cut_right: bool) -> Optional[Tuple[float, float, float]]:
    """Left and right edge of a body, and their row: one in which nothing hides the body.

    :param cut_left, cut_right: whether that edge is the picture's.
    :return: None when the picture cuts it everywhere: it may be nearer than it is wide.
    """
    firsts = rows.argmax(axis=1)
    lasts = rows.shape[1] - rows[:, ::-1].argmax(axis=1)
    whole = rows.any(axis=1)
    if cut_left:
        whole &= firsts > 0
    if cut_right:
        whole &= lasts < rows.shape[1]
    if whole.sum() < max(3.0, LEAST_WHOLE * len(rows)):
        return None
    widths = np.where(whole, lasts - firsts, 0)
    widest = whole & (widths >= np.quantile(widths[whole], 0.8))
    row = float(np.median(np.flatnonzero(widest)))
    return float(np.median(firsts[widest])), float(np.median(lasts[widest])), row


def _by_width(middle: Tuple[float, float], width: float, view: CameraView) -> Optional[np.ndarray]:
    """Where a person stands that appears that wide."""
    ahead = view.ray(*middle)
    level = math.hypot(ahead[0], ahead[1])
    if level < 0.1:
        return None
    place = view.position + ahead * PERSON_RADIUS * 2 * view.matrix[0, 0] / width
    for _ in range(5):
        pixels = view.project(_body(np.array([place[0], place[1], 0.0])))
        if pixels is None:
            # Too near to be seen whole; nearer than its own radius it cannot be.
            return np.array([*(view.position[:2] + ahead[:2] / level * 2 * PERSON_RADIUS), 0.0])
        # In the row that was measured: seen from a camera that looks down, an upright body is a trapezium.
        shown = _width_at(place, view, middle[1])
        place = view.position + (place - view.position) * shown / width
    return np.array([place[0], place[1], 0.0])


def _width_at(place: np.ndarray, view: CameraView, row: float) -> float:
    """How wide a body at a place appears in the row, pixels."""
    offset = place[:2] - view.position[:2]
    distance = float(np.linalg.norm(offset))
    half = math.asin(min(0.95, PERSON_RADIUS / distance))
    heading = math.atan2(offset[1], offset[0])
    edges = []
    for side in (-1, 1):
        angle = heading + side * half
        reach = distance * math.cos(half)
        # The tangents' points at the height that the row's ray has there.
        height = view.position[2] + view.ray(view.width / 2, row)[2] * reach
        point = (
            view.position[0] + reach * math.cos(angle),
            view.position[1] + reach * math.sin(angle),
            height,
        )
        pixel = view.project(np.array([point]))
        if pixel is None:
            return float(view.width)
        edges.append(pixel[0, 0])
    return abs(edges[1] - edges[0])


def _by_feet(box: Box, view: CameraView) -> Optional[np.ndarray]:
    """Where a person stands whose clothes end at the bottom of a rectangle."""
    u, v = (box[0] + box[2]) / 2 - 0.5, box[3] - 0.5
    place = None
    for _ in range(4):
        place = view.on_plane(u, v, 0.0)
        pixels = None if place is None else view.project(_body(place))
        if pixels is None:
            return None
        u += (box[0] + box[2]) / 2 - 0.5 - (pixels[:, 0].min() + pixels[:, 0].max()) / 2
        v += box[3] - 0.5 - pixels[:, 1].max()
    return place


def _body(place: np.ndarray) -> np.ndarray:
    ring = np.stack([PERSON_RADIUS * np.cos(_RING), PERSON_RADIUS * np.sin(_RING), 0 * _RING], axis=1)
    return np.concatenate([ring + place, ring + place + (0.0, 0.0, SHOULDERS)])


def _head(
    place: np.ndarray, skin: np.ndarray, view: CameraView, top_of_head: float = PERSON_HEIGHT
) -> Optional[float]:
    """The share of skin where the head has to be; None when most of that lies outside the picture."""
    middle = np.array([place[0], place[1], top_of_head - HEAD_RADIUS])
    pixels = view.project(middle[None])
    if pixels is None:
        return None
    u, v = pixels[0]
    half = 0.6 * HEAD_RADIUS * view.matrix[0, 0] / float(np.linalg.norm(middle - view.position))
    top, bottom = max(0, round(v - half)), min(view.height, round(v + half) + 1)
    left, right = max(0, round(u - half)), min(view.width, round(u + half) + 1)
    if (bottom - top) * (right - left) < half * half:  # of 4 half²
        return None
    return float(skin[top:bottom, left:right].mean())
