# SPDX-License-Identifier: Apache-2.0
"""Recognition without ROS: from a picture and where it was taken to what stands where."""

from typing import Callable, List, Optional, Sequence, Union

import cv2
import numpy as np

from merlin_reactive.recognition.camera_view import CameraView
from merlin_reactive.recognition.object_classes import TAG
from merlin_reactive.recognition.object_detector import ObjectDetector
from merlin_reactive.recognition.person_detector import PersonDetector
from merlin_reactive.recognition.sighting import Sighting, merge
from merlin_reactive.recognition.tag_detector import TagDetector
from merlin_reactive.recognition.tags import TAG as TAG_EDGE

SUPPORTS = (0.0, 0.4, 0.75, 0.9, 1.1)  # m; floor, tables, counters of the worlds that come with the package
LEAST_SCORE = 0.5


class ObjectRecognizer:
    """Runs the detectors on one picture.

    :param supports: heights above the floor on which things stand, m.
    :param least_score: of what is reported.
    :param tag_edge: of a tag's black square, m.
    """

    def __init__(
        self,
        supports: Sequence[float] = SUPPORTS,
        least_score: float = LEAST_SCORE,
        tag_edge: float = TAG_EDGE,
    ) -> None:
        self._least = least_score
        self._detectors: List[Union[ObjectDetector, PersonDetector, TagDetector]] = [
            ObjectDetector(supports),
            PersonDetector(),
            TagDetector(tag_edge),
        ]

    def recognize(
        self,
        picture: np.ndarray,
        view: CameraView,
        classes: Sequence[str] = (),
        stop: Optional[Callable[[], bool]] = None,
    ) -> List[Sighting]:
        """The things and their places, best score first.

        :param picture: height x width x 3, RGB, 0..255.
        :param classes: what to report; empty: everything.
        :param stop: asked between the detectors; when it says yes, what has been seen so far is returned.
        """
        sightings: List[Sighting] = []
        for detector in self._detectors:
            if stop is not None and stop():
                break
            sightings += detector.detect(picture, view)
        # Only now, because a thing that is not asked for is not to be taken for one that is.
        return [
            sighting
            for sighting in merge(sightings)
            if sighting.score >= self._least and (not classes or _asked(sighting.name, classes))
        ]


def annotated(picture: np.ndarray, sightings: Sequence[Sighting]) -> np.ndarray:
    """A copy of a picture (RGB) with what was recognised drawn into it."""
    image = np.ascontiguousarray(picture).copy()
    colors = {"support": (20, 220, 20), "size": (240, 200, 20), "tag": (20, 200, 240)}
    for sighting in sightings:
        left, top, right, bottom = (round(edge) for edge in sighting.box)
        color = colors[sighting.depth_from]
        cv2.rectangle(image, (left, top), (right, bottom), color, 1)
        x, y, z = sighting.position
        lines = (f"{sighting.name} {sighting.score:.2f}", f"{x:.2f} {y:.2f} {z:.2f}")
        for index, line in enumerate(lines):
            place = (left, max(10, top - 16 + 12 * index))
            cv2.putText(image, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.38, (0, 0, 0), 2, cv2.LINE_AA)
            cv2.putText(image, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.38, color, 1, cv2.LINE_AA)
    return image


def _asked(name: str, classes: Sequence[str]) -> bool:
    return name in classes or (TAG in classes and name.startswith(f"{TAG}_"))
