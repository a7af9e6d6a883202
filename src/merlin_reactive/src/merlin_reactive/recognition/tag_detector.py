# SPDX-License-Identifier: Apache-2.0
"""Finds ArUco tags in a picture, and their poses."""

import math
from typing import Callable, List, Sequence, Tuple

import cv2
import numpy as np

from merlin_reactive.recognition.camera_view import CameraView
from merlin_reactive.recognition.object_classes import TAG
from merlin_reactive.recognition.sighting import Sighting
from merlin_reactive.recognition.tags import TAG as EDGE
from merlin_reactive.recognition.tags import tag_dictionary

Quad = Tuple[int, np.ndarray]  # number, and corners (4 x 2) from the upper left one on, pixels
SURE = 24.0  # pixels along an edge from when a tag counts as fully seen


class TagDetector:
    """Looks for 4x4 tags.

    :param edge: of the black square, m.
    """

    def __init__(self, edge: float = EDGE) -> None:
        self._edge = edge
        half = edge / 2
        self._corners = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])
        self._find = _finder(cv2.aruco.CORNER_REFINE_SUBPIX)
        self._find_exactly = _finder(cv2.aruco.CORNER_REFINE_APRILTAG)

    def detect(self, picture: np.ndarray, view: CameraView) -> List[Sighting]:
        """The tags in a picture (RGB)."""
        gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        found = self._find(gray)
        # The exact way misses small tags and now and then sees one where none is; its corners are better.
        exact = self._find_exactly(gray) if found else []
        return [self._sighting(number, _nearest(number, quad, exact), view) for number, quad in found]

    def _sighting(self, number: int, quad: np.ndarray, view: CameraView) -> Sighting:
        turn, position, error = self._pose(quad, view)
        left, top = quad.min(axis=0)
        right, bottom = quad.max(axis=0)
        length = math.sqrt(cv2.contourArea(quad.astype(np.float32)))
        distance = float(np.linalg.norm(position - view.position))
        return Sighting(
            f"{TAG}_{number}",
            min(1.0, length / SURE) / (1.0 + error),
            tuple(position.tolist()),
            (self._edge, self._edge, 0.0),
            (float(left), float(top), float(right), float(bottom)),
            turn=_quaternion(turn),
            spread=distance / length,
            depth_from="tag",
        )

    def _pose(self, quad: np.ndarray, view: CameraView) -> Tuple[np.ndarray, np.ndarray, float]:
        """Rotation matrix and position in the map frame, and the error of the projection in pixels."""
        _, turns, moves, errors = cv2.solvePnPGeneric(
            self._corners, quad.astype(float), view.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        # A small square fits in two ways; of two that fit alike, tags stand upright rather than lean.
        poses = []
        for turn, move, error in zip(turns, moves, np.ravel(errors)):
            rotation = view.optical[:3, :3] @ cv2.Rodrigues(turn)[0]
            lean = abs(rotation[2, 2])
            poses.append((float(error) + lean, rotation, view.optical[:3, :3] @ move.ravel(), float(error)))
        _, rotation, move, error = min(poses, key=lambda pose: pose[0])
        return rotation, view.position + move, error


def _finder(refinement: int) -> Callable[[np.ndarray], List[Quad]]:
    """A function from a grey picture to the tags in it."""
    new = hasattr(cv2.aruco, "ArucoDetector")  # OpenCV 4.7 and later
    parameters = cv2.aruco.DetectorParameters() if new else cv2.aruco.DetectorParameters_create()
    parameters.cornerRefinementMethod = refinement
    parameters.cornerRefinementWinSize = 2  # a wider one reaches the next cell of a small tag
    dictionary = tag_dictionary()
    detector = cv2.aruco.ArucoDetector(dictionary, parameters) if new else None

    def find(gray: np.ndarray) -> List[Quad]:
        if detector is not None:
            quads, numbers, _ = detector.detectMarkers(gray)
        else:
            quads, numbers, _ = cv2.aruco.detectMarkers(gray, dictionary, parameters=parameters)
        if numbers is None:
            return []
        return [(int(number), quad.reshape(4, 2)) for number, quad in zip(numbers.ravel(), quads)]

    return find


def _nearest(number: int, quad: np.ndarray, others: Sequence[Quad]) -> np.ndarray:
    """The same tag among others, or the given tag."""
    edge = math.sqrt(cv2.contourArea(quad.astype(np.float32)))
    for other, corners in others:
        if other == number and np.abs(corners - quad).max() < 0.25 * edge:
            return corners
    return quad


def _quaternion(turn: np.ndarray) -> Tuple[float, float, float, float]:
    vector = cv2.Rodrigues(turn)[0].ravel()
    angle = float(np.linalg.norm(vector))
    if angle < 1e-9:
        return 0.0, 0.0, 0.0, 1.0
    x, y, z = vector / angle * math.sin(angle / 2)
    return float(x), float(y), float(z), math.cos(angle / 2)
