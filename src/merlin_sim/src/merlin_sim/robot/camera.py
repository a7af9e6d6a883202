"""A colour camera without distortion: its geometry and its noise."""

import math
from dataclasses import dataclass
from typing import List

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

    def projection_matrix(self) -> List[float]:
        """The same for OpenGL, column by column."""
        depth = NEAR - FAR
        matrix = np.zeros((4, 4))
        matrix[0, 0] = 2 * self.focal / self.width
        matrix[1, 1] = 2 * self.focal / self.height
        matrix[2, 2], matrix[2, 3] = (FAR + NEAR) / depth, 2 * FAR * NEAR / depth
        matrix[3, 2] = -1.0
        return matrix.ravel(order="F").tolist()


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

    def view_matrix(self) -> List[float]:
        """Map to OpenGL's camera axes (x right, y up, z back), column by column."""
        axes = self.optical()[:3, :3] * (1.0, -1.0, -1.0)
        matrix = np.eye(4)
        matrix[:3, :3] = axes.T
        matrix[:3, 3] = -axes.T @ self.position
        return matrix.ravel(order="F").tolist()


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
        return np.clip(picture + grain[:, :, None], 0, 255).astype(np.uint8)
