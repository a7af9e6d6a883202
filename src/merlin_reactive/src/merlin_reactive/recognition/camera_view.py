# SPDX-License-Identifier: Apache-2.0
"""Geometry of one picture: from the map to pixels and back."""

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

Box = Tuple[float, float, float, float]  # left, top, right, bottom edge, pixels; right and bottom exclusive


@dataclass(frozen=True)
class CameraView:
    """Where a picture was taken and with what camera.

    :param matrix: intrinsic matrix K (3 x 3) of a camera without distortion.
    :param optical: pose of the optical frame (REP 103) in the map frame (4 x 4).
    """

    matrix: np.ndarray
    optical: np.ndarray
    width: int
    height: int

    @property
    def position(self) -> np.ndarray:
        """Where the camera is, m."""
        return self.optical[:3, 3]

    def project(self, points: np.ndarray) -> Optional[np.ndarray]:
        """The pixels (n x 2) of points of the map (n x 3, m); None when one is behind the camera."""
        local = (np.asarray(points, dtype=float) - self.position) @ self.optical[:3, :3]
        if local[:, 2].min() < 0.05:
            return None
        flat = local @ self.matrix.T
        return flat[:, :2] / flat[:, 2:]

    def box(self, points: np.ndarray) -> Optional[Box]:
        """The part of the rectangle around points of the map that lies in the picture, or None."""
        pixels = self.project(points)
        if pixels is None:
            return None
        # A pixel reaches half a pixel around its middle.
        left, top = np.maximum(pixels.min(axis=0) + 0.5, 0.0)
        right, bottom = np.minimum(pixels.max(axis=0) + 0.5, (self.width, self.height))
        return (left, top, right, bottom) if left < right and top < bottom else None

    def ray(self, u: float, v: float) -> np.ndarray:
        """The direction in the map frame (unit length) of a pixel."""
        local = np.linalg.solve(self.matrix, (u, v, 1.0))
        direction = self.optical[:3, :3] @ local
        return direction / np.linalg.norm(direction)

    def on_plane(self, u: float, v: float, height: float) -> Optional[np.ndarray]:
        """Where the ray of a pixel meets a level plane, m; None when it does not within 20 m."""
        direction = self.ray(u, v)
        if abs(direction[2]) < 1e-6:
            return None
        distance = (height - self.position[2]) / direction[2]
        return self.position + distance * direction if 0.0 < distance < 20.0 else None


def overlap(one: Optional[Box], two: Optional[Box]) -> float:
    """Shared area of two rectangles divided by the area that they cover together, 0..1."""
    if one is None or two is None:
        return 0.0
    width = min(one[2], two[2]) - max(one[0], two[0])
    height = min(one[3], two[3]) - max(one[1], two[1])
    if width <= 0.0 or height <= 0.0:
        return 0.0
    shared = width * height
    return float(shared / (area(one) + area(two) - shared))


def area(box: Box) -> float:
    """Area of a rectangle, square pixels."""
    return (box[2] - box[0]) * (box[3] - box[1])
