"""Object recognition: one look through the camera."""

from typing import Any, Sequence

from merlin_msgs.msg import RecognizeAction, RecognizeGoal

from merlin_sm.states.action_state import ActionState


class RecognizeState(ActionState):
    """Looks for classes of objects and puts what it saw into ``userdata.detections``.

    ``userdata.detections`` becomes a list of (class name, vision_msgs/Detection3D).

    :param classes: names to look for; empty: all that the recogniser knows.
    """

    def __init__(self, classes: Sequence[str] = (), action: str = "recognize", **options: Any) -> None:
        def keep(userdata: Any, result: Any) -> None:
            userdata.detections = [
                (result.names[detection.results[0].id], detection)
                for detection in result.detections.detections
                if detection.results
            ]

        goal = RecognizeGoal(classes=list(classes))
        super().__init__(action, RecognizeAction, goal, on_result=keep, output_keys=["detections"], **options)
