# SPDX-License-Identifier: Apache-2.0
"""Object recognition: one look through the camera."""

from typing import Any, NamedTuple, Sequence, Tuple

from merlin_msgs.msg import RecognizeAction, RecognizeGoal, RecognizeResult
from vision_msgs.msg import Detection3D

from merlin_sm.states.action_state import ActionState


class Recognized(NamedTuple):
    """One thing that was seen."""

    name: str
    detection: Detection3D

    @property
    def score(self) -> float:
        """How sure the recogniser is, 0..1."""
        return float(self.detection.results[0].score)

    @property
    def position(self) -> Tuple[float, float, float]:
        """Position of its middle, m, in the frame of ``detection.header``; recognisers here use ``map``."""
        place = self.detection.results[0].pose.pose.position
        return place.x, place.y, place.z


class RecognizeState(ActionState):
    """Looks for classes of objects and puts what it saw into ``userdata.detections``.

    ``userdata.detections`` becomes a list of :class:`Recognized`, best score first; empty, and still a
    success, when nothing was seen.

    :param classes: names to look for; empty: all that the recogniser knows.
    :param action: name of the recognize action.
    :param least_score: of what is kept, 0..1.
    """

    def __init__(
        self,
        classes: Sequence[str] = (),
        action: str = "recognize",
        least_score: float = 0.0,
        **options: Any,
    ) -> None:
        def keep(userdata: Any, result: RecognizeResult) -> None:
            seen = [item for item in recognized(result) if item.score >= least_score]
            userdata.detections = sorted(seen, key=lambda item: -item.score)

        goal = RecognizeGoal(classes=list(classes))
        super().__init__(action, RecognizeAction, goal, on_result=keep, output_keys=["detections"], **options)
        self.asks = tuple(classes)


def recognized(result: RecognizeResult) -> Sequence[Recognized]:
    """The detections of a result of ``recognize`` that have a known name."""
    return [
        Recognized(result.names[detection.results[0].id], detection)
        for detection in result.detections.detections
        if detection.results and 0 <= detection.results[0].id < len(result.names)
    ]
