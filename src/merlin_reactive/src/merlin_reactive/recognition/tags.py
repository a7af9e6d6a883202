# SPDX-License-Identifier: Apache-2.0
"""The ArUco tags that are recognised."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import cv2

TAG = 0.10  # m, edge of the black square, unless a parameter says otherwise


def tag_dictionary() -> "cv2.aruco.Dictionary":
    """The tags that world files number: 4x4, 0 to 49."""
    import cv2  # a simulator without tags does without it

    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
