# SPDX-License-Identifier: Apache-2.0
"""Where a recogniser's pictures come from: the simulator's camera on request, or a camera's topics."""

import threading
from typing import Optional, Tuple

import cv2
import numpy as np
import rospy
from cv_bridge import CvBridge, CvBridgeError
from merlin_msgs.srv import CaptureImage
from sensor_msgs.msg import CameraInfo, Image

from merlin_ros.deadline import Deadline
from merlin_ros.service_proxy import ServiceError, ServiceProxy

Picture = Tuple[Image, CameraInfo]
CAPTURE_LIMIT = 20.0  # s of wall time for the simulator's answer, which renders on a busy machine


class NoPicture(Exception):
    """No picture came; the text says why."""


class CaptureSource:
    """Asks the service ``camera/capture``."""

    def __init__(self) -> None:
        self._capture = ServiceProxy("camera/capture", CaptureImage, timeout=CAPTURE_LIMIT)

    def take(self, _: threading.Event) -> Picture:
        """A picture of now.

        :raises NoPicture: the simulator gives none.
        """
        try:
            answer = self._capture()
        except ServiceError as error:
            raise NoPicture(f"no camera image: {error}") from error
        if not answer.success:
            raise NoPicture(f"no camera image: {answer.message}")
        return answer.image, answer.info


class TopicSource:
    """Subscribes to an image topic and its camera_info while a picture is wanted.

    :param image_topic: sensor_msgs/Image.
    :param info_topic: sensor_msgs/CameraInfo; empty: ``camera_info`` beside the image.
    :param timeout: s of running time for both to come.
    """

    def __init__(self, image_topic: str, info_topic: str, timeout: float) -> None:
        self._image_topic = rospy.resolve_name(image_topic)
        beside = self._image_topic.rsplit("/", 1)[0] + "/camera_info"
        self._info_topic = rospy.resolve_name(info_topic or beside)
        self._timeout = timeout
        self._news = threading.Condition()  # guards the two messages
        self._image: Optional[Image] = None
        self._info: Optional[CameraInfo] = None

    def take(self, cancelled: threading.Event) -> Picture:
        """The next picture.

        :raises NoPicture: none came in time, or none is wanted any more.
        """
        with self._news:
            self._image = self._info = None
        subscribers = [
            rospy.Subscriber(self._image_topic, Image, self._keep_image, queue_size=1, buff_size=2**24),
            rospy.Subscriber(self._info_topic, CameraInfo, self._keep_info, queue_size=1),
        ]
        try:
            with self._news:
                Deadline(self._timeout).wait(
                    self._news, lambda: cancelled.is_set() or bool(self._image and self._info)
                )
                image, info = self._image, self._info
        finally:
            for subscriber in subscribers:
                subscriber.unregister()
        if image is None or info is None:
            missing = self._image_topic if image is None else self._info_topic
            raise NoPicture(f"no camera image: nothing came on {missing} within {self._timeout:g} s")
        if (info.width, info.height) != (image.width, image.height):
            raise NoPicture(
                f"{self._info_topic} is for {info.width} x {info.height} pixels, the image has "
                f"{image.width} x {image.height}"
            )
        return image, info

    def wake(self) -> None:
        """Wakes a wait, so that it re-checks its event."""
        with self._news:
            self._news.notify_all()

    def _keep_image(self, message: Image) -> None:
        with self._news:
            self._image = message
            self._news.notify_all()

    def _keep_info(self, message: CameraInfo) -> None:
        with self._news:
            self._info = message
            self._news.notify_all()


DISTORTIONS = ("plumb_bob", "rational_polynomial")  # those that OpenCV has


def rectified(bridge: CvBridge, image: Image, info: CameraInfo) -> Tuple[np.ndarray, np.ndarray]:
    """The pixels of an image without distortion, RGB, and its intrinsic matrix (3 x 3).

    :raises NoPicture: the image, or the calibration, cannot be used.
    """
    if not image.width * image.height:
        raise NoPicture("the camera image cannot be read: it has no pixels")
    try:
        pixels = bridge.imgmsg_to_cv2(image, "rgb8")
    except (CvBridgeError, TypeError, ValueError) as error:  # the last two: data of another size
        raise NoPicture(f"the camera image cannot be read: {error}") from error
    matrix = np.array(info.K).reshape(3, 3)
    if not (matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0 and np.isfinite(matrix).all()):
        raise NoPicture("the camera is not calibrated: its camera_info has no focal length")
    if any(info.D):
        if info.distortion_model not in ("", *DISTORTIONS):
            raise NoPicture(
                f"the camera's distortion is {info.distortion_model!r}; known: {', '.join(DISTORTIONS)}"
            )
        try:
            pixels = cv2.undistort(pixels, matrix, np.array(info.D))
        except cv2.error as error:
            raise NoPicture(f"the camera's distortion cannot be used: {list(info.D)}") from error
    return pixels, matrix
