# SPDX-License-Identifier: Apache-2.0
"""Images of a real camera are rectified before things are looked for, or refused with the reason."""

import math
from typing import Sequence

import cv2
import numpy as np
import pytest
from cv_bridge import CvBridge
from sensor_msgs.msg import CameraInfo, Image

from merlin_reactive.recognition.image_source import NoPicture, rectified

BRIDGE = CvBridge()
K = [300.0, 0.0, 160.0, 0.0, 300.0, 120.0, 0.0, 0.0, 1.0]
BARREL = [-0.3, 0.1, 0.001, -0.001, 0.0]


def image(pixels: np.ndarray) -> Image:
    return BRIDGE.cv2_to_imgmsg(pixels, "rgb8")


def info(
    distortion: Sequence[float] = (), model: str = "plumb_bob", matrix: Sequence[float] = K
) -> CameraInfo:
    return CameraInfo(K=matrix, D=distortion, distortion_model=model)


def dot(x: float, y: float) -> np.ndarray:
    pixels = np.zeros((240, 320, 3), np.uint8)
    cv2.circle(pixels, (round(x), round(y)), 3, (255, 255, 255), -1)
    return pixels


@pytest.mark.parametrize("model", ["plumb_bob", ""])
def test_what_a_lens_bends_stands_where_a_pinhole_camera_sees_it(model: str) -> None:
    point = np.array([[0.4, 0.3, 1.0]])
    straight = (300.0 * 0.4 + 160.0, 300.0 * 0.3 + 120.0)
    matrix = np.array(K).reshape(3, 3)
    bent = cv2.projectPoints(point, np.zeros(3), np.zeros(3), matrix, np.array(BARREL))[0].ravel()
    assert math.dist(bent, straight) > 8.0
    pixels, returned = rectified(BRIDGE, image(dot(*bent)), info(BARREL, model))
    rows, columns = np.nonzero(pixels[:, :, 0] > 128)
    assert math.dist((columns.mean(), rows.mean()), straight) < 1.5
    assert (returned == matrix).all()


def test_a_camera_without_distortion_is_left_as_it_is() -> None:
    pixels = dot(80.0, 60.0)
    assert (rectified(BRIDGE, image(pixels), info([0.0] * 5, "equidistant"))[0] == pixels).all()


@pytest.mark.parametrize(
    ("camera", "why"),
    [
        (info(matrix=[0.0] * 9), "not calibrated"),
        (info(matrix=[math.nan, *K[1:]]), "not calibrated"),
        (info(BARREL, "equidistant"), "'equidistant'; known: plumb_bob, rational_polynomial"),
        (info([0.1, 0.2, 0.3]), r"cannot be used: \[0.1, 0.2, 0.3\]"),
    ],
)
def test_a_calibration_that_cannot_be_used_is_refused(camera: CameraInfo, why: str) -> None:
    with pytest.raises(NoPicture, match=why):
        rectified(BRIDGE, image(dot(80.0, 60.0)), camera)


@pytest.mark.parametrize(
    ("encoding", "data", "width"),
    [
        ("rgb8", bytes(100), 320),
        ("bgr8", b"", 320),
        ("rgb8", b"", 0),
        ("bgr8", b"", 0),
        ("ultraviolet", bytes(240 * 320 * 3), 320),
    ],
)
def test_a_picture_that_cannot_be_read_is_refused(encoding: str, data: bytes, width: int) -> None:
    strange = Image(width=width, height=240, step=3 * width, encoding=encoding, data=data)
    with pytest.raises(NoPicture, match="cannot be read"):
        rectified(BRIDGE, strange, info())
