# SPDX-License-Identifier: Apache-2.0
"""Geometry of one picture: from the map to pixels and back."""

import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, Optional, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped

Box = Tuple[float, float, float, float]  # left, top, right, bottom edge, pixels; right and bottom exclusive


WAIT = 0.5  # s of wall time for the transforms of a picture that has just been taken
TOLERANCE = (
    0.3  # s of ROS time between a picture and the transforms that place it, if there are no nearer ones
)


class NotPlaced(Exception):
    """The camera's pose is unknown; the text says what is missing."""


class CameraPlacement(tf2_ros.Buffer):
    """A transform buffer that wakes the waiters for a transform.

    :param frame: that poses are wanted in.
    """

    def __init__(self, frame: str) -> None:
        super().__init__()
        self._frame = frame
        self._news = threading.Condition()
        self._listener = tf2_ros.TransformListener(self)

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """Called by the listener for each transform that arrives."""
        super().set_transform(transform, authority)
        self.wake()

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Stores a static transform, and wakes who waits for one."""
        super().set_transform_static(transform, authority)
        self.wake()

    def wake(self) -> None:
        """Wakes a wait, so that it re-checks."""
        with self._news:
            self._news.notify_all()

    def at(self, camera: str, stamp: rospy.Time, stop: Callable[[], bool]) -> np.ndarray:
        """The pose of a camera's optical frame at a time, as a 4 x 4 matrix: camera to map.

        :param stop: ends the wait for the transform when it says yes.
        :raises NotPlaced: tf does not know it.
        """
        end = time.monotonic() + WAIT
        with self._news:
            while True:
                try:
                    return _matrix(self.lookup_transform_core(self._frame, camera, stamp))
                except tf2_ros.TransformException:
                    left = end - time.monotonic()
                if left <= 0.0 or stop():
                    break
                self._news.wait(left)
        return self._latest(camera, stamp)

    def _latest(self, camera: str, stamp: rospy.Time) -> np.ndarray:
        try:
            latest: Any = self.lookup_transform_core(self._frame, camera, rospy.Time(0))
        except tf2_ros.TransformException as error:
            raise NotPlaced(
                f"no transform from {camera} to {self._frame}; do robot_state_publisher and localisation "
                f"run? ({error})"
            ) from error
        age = (stamp - latest.header.stamp).to_sec()
        if abs(age) > TOLERANCE and not latest.header.stamp.is_zero():
            raise NotPlaced(
                f"the transform from {camera} to {self._frame} and the picture are {abs(age):.1f} s apart"
            )
        return _matrix(latest)


def _matrix(message: TransformStamped) -> np.ndarray:
    move, turn = message.transform.translation, message.transform.rotation
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = (move.x, move.y, move.z)
    return matrix


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
