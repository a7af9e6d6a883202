# SPDX-License-Identifier: Apache-2.0
"""The node ``recognition``: finds which objects and persons stand where in one camera image."""

import time
from typing import List, Tuple, Union

import numpy as np
import rospy
from cv_bridge import CvBridge
from merlin_msgs.msg import RecognizeAction, RecognizeResult
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

from merlin_reactive.recognition.camera_placement import CameraPlacement, NotPlaced
from merlin_reactive.recognition.camera_view import CameraView
from merlin_reactive.recognition.image_source import CaptureSource, NoPicture, TopicSource, rectified
from merlin_reactive.recognition.object_classes import unknown_classes
from merlin_reactive.recognition.object_recognizer import LEAST_SCORE, SUPPORTS, ObjectRecognizer, annotated
from merlin_reactive.recognition.sighting import Sighting
from merlin_reactive.recognition.tags import TAG
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.actions.serial_action_server import SerialActionServer
from merlin_ros.health import OK, WARN, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, graph_name, number


class RecognitionNode:
    """Serves the action ``recognize``.

    :raises ParameterError: a parameter cannot be used.
    """

    def __init__(self) -> None:
        least = number("~least_score", LEAST_SCORE, 0.0)
        self._recognizer = ObjectRecognizer(_supports(), least, number("~tag_size", TAG, 0.005))
        self._frame = str(rospy.get_param("~global_frame", "map")).lstrip("/")
        topic = graph_name("~image_topic")
        self._source: Union[CaptureSource, TopicSource] = CaptureSource()
        if topic:
            info = graph_name("~camera_info_topic")
            self._source = TopicSource(topic, info, number("~image_timeout", 5.0, 0.1))
        self._placement = CameraPlacement(self._frame)
        self._bridge = CvBridge()
        self._drawn = rospy.Publisher("recognition/image", Image, queue_size=1, latch=True)
        self._looks, self._problem, self._took = 0, "", 0.0  # written by the action's worker only
        self._server = SerialActionServer("recognize", RecognizeAction, self._execute, self._cancel)
        rospy.on_shutdown(self._server.shutdown)
        self._server.start()

    def health(self) -> Health:
        """Health by the last look."""
        values = {"looks": self._looks, "last look, s": f"{self._took:.3f}"}
        if self._problem:
            return Health(WARN, self._problem, values)
        return Health(OK, "ready", values)

    def _cancel(self, goal: ServerGoal) -> None:
        # A look changes nothing in the world, so it need not come to an end before the answer.
        goal.cancelled(RecognizeResult(), "cancelled")
        self._placement.wake()
        if isinstance(self._source, TopicSource):
            self._source.wake()

    def _execute(self, goal: ServerGoal) -> None:
        begun = time.monotonic()
        unknown = unknown_classes(goal.goal.classes)
        if unknown:
            goal.abort(RecognizeResult(), unknown)
            return
        try:
            header, sightings = self._look(goal)
        except (NoPicture, NotPlaced) as error:
            if not goal.cancel_requested:
                self._problem = str(error)
            goal.abort(RecognizeResult(), str(error))
            return
        self._problem = ""
        self._looks += 1
        self._took = time.monotonic() - begun
        names = list(dict.fromkeys(sighting.name for sighting in sightings))
        detections = Detection3DArray(detections=[_detection(s, names, header) for s in sightings])
        detections.header = header
        goal.succeed(
            RecognizeResult(detections=detections, names=names), _in_words(sightings, goal.goal.classes)
        )

    def _look(self, goal: ServerGoal) -> Tuple[rospy.Header, List[Sighting]]:
        image, info = self._source.take(goal.cancel_event)
        optical = self._placement.at(
            image.header.frame_id, image.header.stamp, lambda: bool(goal.cancel_requested)
        )
        pixels, matrix = rectified(self._bridge, image, info)
        view = CameraView(matrix, optical, image.width, image.height)
        sightings = self._recognizer.recognize(
            pixels, view, goal.goal.classes, lambda: bool(goal.cancel_requested)
        )
        drawing = self._bridge.cv2_to_imgmsg(annotated(pixels, sightings), "rgb8")
        drawing.header = image.header
        self._drawn.publish(drawing)
        return rospy.Header(stamp=image.header.stamp, frame_id=self._frame), sightings


def _supports() -> List[float]:
    heights = rospy.get_param("~support_heights", list(SUPPORTS))
    if not isinstance(heights, list) or not all(
        isinstance(height, (int, float)) and not isinstance(height, bool) for height in heights
    ):
        raise ParameterError(f"parameter ~support_heights is {heights!r}, not a list of numbers")
    return [float(height) for height in heights]


def _detection(sighting: Sighting, names: List[str], header: rospy.Header) -> Detection3D:
    detection = Detection3D(header=header)
    hypothesis = ObjectHypothesisWithPose(id=names.index(sighting.name), score=sighting.score)
    center = detection.bbox.center
    center.position.x, center.position.y, center.position.z = sighting.position
    turn = center.orientation
    turn.x, turn.y, turn.z, turn.w = sighting.turn
    detection.bbox.size.x, detection.bbox.size.y, detection.bbox.size.z = sighting.size
    hypothesis.pose.pose = center
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.eye(3) * sighting.spread**2
    hypothesis.pose.covariance = covariance.ravel().tolist()
    detection.results = [hypothesis]
    return detection


def _in_words(sightings: List[Sighting], classes: List[str]) -> str:
    if not sightings:
        return f"saw nothing of {', '.join(classes)}" if classes else "saw nothing"
    names = [sighting.name for sighting in sightings]
    return "saw " + ", ".join(f"{names.count(name)} {name}" for name in dict.fromkeys(names))


def main() -> int:
    """The executable ``recognition``; returns its exit code."""
    return run_node("recognition", lambda: HealthReporter({"recognition": RecognitionNode().health}).start())
