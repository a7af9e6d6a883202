# SPDX-License-Identifier: Apache-2.0
"""Where a camera was when it took a picture, from tf."""

import threading
import time
from typing import Any, Callable

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped

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
        camera = camera.lstrip("/")
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
