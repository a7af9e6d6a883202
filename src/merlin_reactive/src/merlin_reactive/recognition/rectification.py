# SPDX-License-Identifier: Apache-2.0
"""Camera images as a camera without distortion would have taken them."""

from typing import Tuple

import cv2
import numpy as np
from cv_bridge import CvBridge, CvBridgeError
from sensor_msgs.msg import CameraInfo, Image

from merlin_reactive.recognition.image_source import NoPicture

DISTORTIONS = ("plumb_bob", "rational_polynomial")  # those that OpenCV has


def rectified(bridge: CvBridge, image: Image, info: CameraInfo) -> Tuple[np.ndarray, np.ndarray]:
    """The pixels of an image without distortion, RGB, and its intrinsic matrix (3 x 3).

    :raises NoPicture: the image, or the calibration, cannot be used.
    """
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
