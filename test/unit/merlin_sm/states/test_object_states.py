# SPDX-License-Identifier: Apache-2.0
"""States that look for objects, and those that have an arm handle them."""

from typing import Any, Dict, List, Tuple

import pytest
from actionlib_msgs.msg import GoalStatus
from fakes.action_server import Server, userdata
from geometry_msgs.msg import PoseStamped
from merlin_msgs.msg import RecognizeResult
from vision_msgs.msg import Detection3D, ObjectHypothesisWithPose

from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.manipulation import CloseState, OpenState, PickState, PlaceState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_sm.states.recognition import NOT_FOUND, DetectState, Recognized, RecognizeState


def seen(names: List[str], *scores: Tuple[int, float]) -> RecognizeResult:
    result = RecognizeResult(names=names)
    result.detections.detections = [
        Detection3D(results=[ObjectHypothesisWithPose(id=number, score=score)]) for number, score in scores
    ]
    return result


def test_what_was_seen_is_kept_best_first_and_what_has_no_name_is_not(server: Server) -> None:
    result = seen(["cup", "plate"], (0, 0.4), (1, 0.9), (0, 0.1), (7, 1.0))
    result.detections.detections.append(Detection3D())
    server.end = (GoalStatus.SUCCEEDED, "", result)
    data = userdata()
    assert RecognizeState(["cup"], least_score=0.2).execute(data) == SUCCEEDED
    assert [(item.name, item.score) for item in data.detections] == [("plate", 0.9), ("cup", 0.4)]
    assert list(server.goals[0].classes) == ["cup"]


def test_seeing_nothing_is_a_success(server: Server) -> None:
    server.end = (GoalStatus.SUCCEEDED, "", seen([]))
    data: Dict[str, Any] = userdata()
    assert RecognizeState().execute(data) == SUCCEEDED and data.detections == []


@pytest.mark.parametrize(
    ("wanted", "outcome", "reason", "kept"),
    [
        ("cup", SUCCEEDED, "", [0.9, 0.4]),
        ("plate", NOT_FOUND, "plate was not seen at desk", []),
    ],
)
def test_one_object_is_looked_for(
    server: Server, wanted: str, outcome: str, reason: str, kept: List[float]
) -> None:
    server.end = (GoalStatus.SUCCEEDED, "", seen(["cup", "plate"], (0, 0.4), (1, 0.1), (0, 0.9)))
    look = DetectState("{o}", "{s}", least_score=0.2)
    machine = MerlinSM([SUCCEEDED, NOT_FOUND, ABORTED, PREEMPTED], ["o", "s"], ["detections"])
    with machine:
        machine.add("LOOK", look)
    data = userdata(o=wanted, s="desk")
    assert (machine.execute(data), machine.reason) == (outcome, reason)
    assert [item.score for item in data.detections] == kept
    assert list(server.goals[0].classes) == [wanted]


def test_a_look_that_fails_is_no_look_that_finds_nothing(server: Server) -> None:
    server.end = (GoalStatus.ABORTED, "no camera", None)
    look = DetectState("cup")
    assert (look.execute(userdata()), look.reason) == (ABORTED, "/server aborted: no camera")


def test_only_words_that_are_known_before_are_compared_with_the_recogniser(server: Server) -> None:
    assert (RecognizeState(["cup", "{o}"]).asks, DetectState("{o}").asks) == (("cup",), ())


@pytest.mark.parametrize("kind", [PickState, PlaceState, OpenState, CloseState])
def test_what_an_arm_is_asked_for(server: Server, kind: Any) -> None:
    work = kind("{o}", "{s}")
    assert work.execute(userdata(o="cup", s="desk")) == SUCCEEDED
    (goal,) = server.goals
    assert (goal.object, goal.place, goal.pose) == ("cup", "desk", PoseStamped())
    assert (work.action, kind("cup", action="left/arm").action) == (kind.does, "left/arm")


def test_the_best_pose_that_was_seen_goes_with_the_goal(server: Server) -> None:
    found = seen(["cup"], (0, 0.4), (0, 0.9)).detections.detections
    for detection, x in zip(found, (1.0, 2.0)):
        detection.header.frame_id = "map"
        detection.results[0].pose.pose.position.x = x
    data = userdata(detections=[Recognized("cup", each) for each in found])
    assert PickState("cup", seen="detections").execute(data) == SUCCEEDED
    pose = server.goals[0].pose
    assert (pose.header.frame_id, pose.pose.position.x) == ("map", 2.0)


@pytest.mark.parametrize(("own", "frame"), [("", "map"), ("camera", "camera")])
def test_a_detection_without_a_frame_has_that_of_its_array(server: Server, own: str, frame: str) -> None:
    result = seen(["cup"], (0, 0.9))
    result.detections.header.frame_id = "map"
    result.detections.detections[0].header.frame_id = own
    server.end = (GoalStatus.SUCCEEDED, "", result)
    data = userdata()
    assert DetectState("cup").execute(data) == SUCCEEDED
    server.end = (GoalStatus.SUCCEEDED, "", None)
    assert PickState("cup", seen="detections").execute(data) == SUCCEEDED
    assert server.goals[1].pose.header.frame_id == frame


def test_of_what_a_detection_may_be_the_surest_counts(server: Server) -> None:
    result = seen(["bottle", "cup"], (0, 0.3))
    (detection,) = result.detections.detections
    detection.results.append(ObjectHypothesisWithPose(id=1, score=0.9))
    detection.results[1].pose.pose.position.x = 2.0
    server.end = (GoalStatus.SUCCEEDED, "", result)
    data = userdata()
    assert DetectState("bottle").execute(data) == NOT_FOUND
    assert DetectState("cup", least_score=0.5).execute(data) == SUCCEEDED
    (cup,) = data.detections
    assert (cup.name, cup.score, cup.position) == ("cup", 0.9, (2.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("plate", "plate is not among what was seen; look for it first"),
        ("", "pick has no object; its name is empty"),
    ],
)
def test_an_arm_is_not_asked_for_what_it_cannot_know(server: Server, name: str, reason: str) -> None:
    work = PickState("{o}", seen="detections")
    assert work.execute(userdata(o=name, detections=[])) == ABORTED
    assert (work.reason, server.goals) == (reason, [])
