# SPDX-License-Identifier: Apache-2.0
"""Object recognition: one look through the camera."""

from copy import copy
from typing import Any, List, NamedTuple, Optional, Sequence, Tuple

from merlin_msgs.msg import RecognizeAction, RecognizeGoal, RecognizeResult
from vision_msgs.msg import Detection3D

from merlin_sm.states.action_state import ActionState
from merlin_sm.states.ros_calls import check_shares
from merlin_sm.states.text_keys import filled, keys_of
from merlin_sm.userdata_keys import check_lists

NOT_FOUND = "not_found"


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

    :param classes: names to look for, ``{key}`` is replaced by the userdata of that name; empty: all that the
        recogniser knows.
    :param action: name of the recognize action.
    :param least_score: of what is kept, 0..1.
    """

    def __init__(
        self, classes: Sequence[str] = (), action: str = "recognize", least_score: float = 0.0, **options: Any
    ) -> None:
        given = options.pop("input_keys", ())
        check_lists(classes=classes, input_keys=given)
        check_shares(least_score=least_score)
        inputs = [*keys_of(classes), *given]
        super().__init__(
            action,
            RecognizeAction,
            lambda userdata: RecognizeGoal(classes=[filled(name, userdata) for name in classes]),
            on_result=self._keep,
            input_keys=list(dict.fromkeys(inputs)),
            output_keys=["detections"],
            **options,
        )
        self.asks = tuple(name for name in classes if not keys_of([name]))
        self._least_score = least_score

    def _keep(self, userdata: Any, result: RecognizeResult) -> Optional[str]:
        userdata.detections = self._seen(result)
        return None

    def _seen(self, result: RecognizeResult) -> List[Recognized]:
        seen = [item for item in recognized(result) if item.score >= self._least_score]
        return sorted(seen, key=lambda item: -item.score)


class DetectState(RecognizeState):
    """Looks for one object. ``userdata.detections`` becomes what was seen of it, best score first.

    The outcome not_found means that the recogniser has looked and does not see it; the reason says so.

    :param name: as the recogniser knows it; ``{key}`` is replaced by the userdata of that name.
    :param place: where the robot looks, for that reason; likewise.
    :param action: name of the recognize action.
    :param least_score: below which it is not seen, 0..1.
    """

    def __init__(
        self, name: str, place: str = "", action: str = "recognize", least_score: float = 0.0, **options: Any
    ) -> None:
        keys = keys_of([place])
        super().__init__([name], action, least_score, outcomes=[NOT_FOUND], input_keys=keys, **options)
        self._named, self._place = name, place

    def _keep(self, userdata: Any, result: RecognizeResult) -> Optional[str]:
        name, place = filled(self._named, userdata), filled(self._place, userdata)
        found = userdata.detections = [item for item in self._seen(result) if item.name == name]
        if found:
            return None
        self.reason = f"{name} was not seen" + (f" at {place}" if place else "")
        return NOT_FOUND


def recognized(result: RecognizeResult) -> Sequence[Recognized]:
    """The detections of a result of ``recognize`` that have a known name.

    Their hypotheses come surest first, and one without a frame has the header of the array.
    """
    found = []
    for detection in map(copy, result.detections.detections):
        detection.results = sorted(detection.results, key=lambda hypothesis: -hypothesis.score)
        if not detection.header.frame_id:
            detection.header = result.detections.header
        if detection.results and 0 <= detection.results[0].id < len(result.names):
            found.append(Recognized(result.names[detection.results[0].id], detection))
    return found
