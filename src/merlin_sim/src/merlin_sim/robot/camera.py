# SPDX-License-Identifier: Apache-2.0
"""A colour camera without distortion: its geometry and its noise."""

import math
from dataclasses import dataclass

import numpy as np

from merlin_reactive.seeded_random import draw

CAMERA_LINK = "camera_link"  # of the robot description; it looks along its x axis, z is up
NEAR, FAR = 0.06, 40.0  # m; what is nearer or farther is not drawn
# Columns: the optical frame's axes (x right, y down, z ahead, REP 103) in the camera link's.
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class CameraError(Exception):
    """No picture can be taken; the text says why."""


@dataclass(frozen=True)
class CameraModel:
    """What is special about a camera.

    :param fov: horizontal field of view, rad.
    :param noise: standard deviation of the brightness of a pixel, of 255.
    """

    width: int = 640
    height: int = 480
    fov: float = math.radians(70.0)
    noise: float = 3.0

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return self.width / 2 / math.tan(self.fov / 2)

    def matrix(self) -> np.ndarray:
        """The intrinsic matrix K: optical frame to pixels; whole numbers are the middles of pixels."""
        return np.array(
            [
                [self.focal, 0.0, (self.width - 1) / 2],
                [0.0, self.focal, (self.height - 1) / 2],
                [0.0, 0.0, 1.0],
            ]
        )


@dataclass(frozen=True)
class CameraPose:
    """Where a camera link is in the map frame: position (m) and rotation matrix."""

    position: np.ndarray
    turn: np.ndarray

    def optical(self) -> np.ndarray:
        """The pose of the optical frame as a 4 x 4 matrix: optical frame to map."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.turn @ OPTICAL
        matrix[:3, 3] = self.position
        return matrix


class Camera:
    """One robot's camera."""

    def __init__(self, model: CameraModel, seed: int, robot: str) -> None:
        self.model = model
        self._seed, self._stream = seed, f"{robot}/camera"

    def expose(self, picture: np.ndarray, tick: int) -> np.ndarray:
        """A clean picture with the noise of a moment, in physics steps."""
        if not self.model.noise:
            return picture.copy()
        random = draw(self._seed, self._stream, tick)
        grain = random.standard_normal(picture.shape[:2], dtype=np.float32) * self.model.noise
        exposed, noisy = np.empty(picture.shape, dtype=np.uint8), np.empty_like(grain)
        # One colour after the other, in one place: new memory for each costs more than the sums.
        for color in range(picture.shape[2]):
            np.add(picture[:, :, color], grain, out=noisy)
            np.clip(noisy, 0, 255, out=noisy)
            exposed[:, :, color] = noisy
        return exposed
