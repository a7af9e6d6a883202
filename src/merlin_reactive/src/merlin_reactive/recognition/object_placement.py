# SPDX-License-Identifier: Apache-2.0
"""Where a thing of known size stands, from its outline in a picture."""

import math
from typing import Optional, Tuple

import cv2
import numpy as np

from merlin_reactive.recognition.camera_view import Box, CameraView, area
from merlin_reactive.recognition.object_classes import ObjectClass

OUTER = 0.4  # share of a thing's width, from its free side, where nothing beside it disturbs
_CORNERS = np.array([(0.5, 0.5, 0.0), (-0.5, 0.5, 0.0), (-0.5, -0.5, 0.0), (0.5, -0.5, 0.0)])
_RING = np.linspace(0.0, 2 * math.pi, 16, endpoint=False)


def outline(
    kind: ObjectClass, bottom: np.ndarray, low: float = 0.0, high: float = -1.0, yaw: float = 0.0
) -> np.ndarray:
    """Points around a thing between two heights above its bottom, m; without them: around what has colour.

    :param yaw: heading of a box in the map frame, rad.
    """
    if high < 0.0:
        high = kind.height * (1.0 - kind.dark_height)
    if kind.size is None:
        radius = kind.width / 2
        ring = np.stack([radius * np.cos(_RING), radius * np.sin(_RING), np.zeros_like(_RING)], axis=1)
    else:
        cos, sin = math.cos(yaw), math.sin(yaw)
        ring = _CORNERS * (*kind.size, 0.0) @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([ring + bottom + (0.0, 0.0, low), ring + bottom + (0.0, 0.0, high)])


def silhouette(view: CameraView, points: np.ndarray, window: Box) -> np.ndarray:
    """Which pixels of a window lie within the outline of a convex thing.

    :param points: around it, n x 3, m.
    :param window: whole pixels.
    """
    left, top, right, bottom = map(int, window)
    u, v = np.meshgrid(np.arange(left, right), np.arange(top, bottom))
    inside = (u >= 0) & (u < view.width) & (v >= 0) & (v < view.height)
    pixels = view.project(points)
    if pixels is None:
        return np.zeros_like(inside)
    hull = cv2.convexHull(pixels.astype(np.float32))[:, 0].astype(float)
    middle = hull.mean(axis=0)
    for one, two in zip(hull, np.roll(hull, -1, axis=0)):
        along = two - one
        side = along[0] * (v - one[1]) - along[1] * (u - one[0])
        inner = along[0] * (middle[1] - one[1]) - along[1] * (middle[0] - one[0])
        inside &= side * inner >= 0.0
    return inside


def placed(
    kind: ObjectClass, box: Box, view: CameraView, height: Optional[float], edge: int, yaw: float = 0.0
) -> Optional[np.ndarray]:
    """Where a thing stands (its bottom's middle) that appears in the middle of a rectangle.

    :param height: of what it stands on; None: it may hang anywhere.
    :param edge: of the rectangle that it appears at too: 1 the top, 3 the bottom.
    :param yaw: heading of a box in the map frame, rad.
    """
    u, v = (box[0] + box[2]) / 2 - 0.5, (box[1] + box[3]) / 2 - 0.5
    distance = view.matrix[0, 0] * kind.width / (box[2] - box[0])
    for _ in range(5):
        if height is None:
            place = view.position + distance * view.ray(u, v) - (0.0, 0.0, kind.height / 2)
        else:
            place = view.on_plane(u, v, height)
        pixels = None if place is None else view.project(outline(kind, place, yaw=yaw))
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


def beside(
    kind: ObjectClass,
    box: Box,
    shape: np.ndarray,
    view: CameraView,
    height: float,
    side: int,
    yaw: float = 0.0,
) -> Optional[Tuple[np.ndarray, Box, Box]]:
    """Where a thing stands that makes one side of a patch, with others beside, before or behind it.

    :param shape: pixels of the rectangle that belong to the patch.
    :param height: of what it stands on, m.
    :param side: of the rectangle: 0 left, 1 top, 2 right, 3 bottom.
    :param yaw: heading of a box in the map frame, rad.
    :return: its bottom's middle, the part of the patch that is it, and the rectangle that it should fill.
    """
    across = side % 2  # 0: it is found along the columns, by its bottom; 1: along the rows, by its middle
    found: Optional[Tuple[np.ndarray, Box, Box]] = None
    u, v = (box[side], box[3] - 1.0) if across == 0 else ((box[0] + box[2]) / 2, box[side])
    for _ in range(8):
        place = view.on_plane(u, v, height)
        pixels = None if place is None else view.project(outline(kind, place, yaw=yaw))
        if place is None or pixels is None:
            return None
        low, high = pixels.min(axis=0) + 0.5, pixels.max(axis=0) + 0.5
        expected = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        reach = max(1, round(OUTER * (high[across] - low[across])))
        slots = shape if across == 1 else shape.T  # along the side's own direction first
        outer = slots[:reach] if side < 2 else slots[-reach:]
        filled = np.flatnonzero(outer.any(axis=0)) + box[1 - across]
        first, last = float(filled[0]), float(filled[-1] + 1)
        if across == 0:
            u += box[side] - expected[side]
            v += last - expected[3]
            part = (expected[0], first, expected[2], last)
        else:
            u += (first + last - expected[0] - expected[2]) / 2
            v += box[side] - expected[side]
            part = (first, expected[1], last, expected[3])
        found = place, part, expected
    return found
