"""The server of a container answers each goal, whatever users' code leaves in the result or raises."""

import io
import threading
from types import SimpleNamespace
from typing import Any, List, Tuple

import pytest
import rospy
from merlin_msgs.msg import ListenAction, ListenGoal

import smach
from smach_ros import action_server_wrapper
from smach_ros.action_server_wrapper import ActionServerWrapper

LONG = 60.0


class Goal:
    """A goal handle of actionlib; what cannot be written is not sent."""

    def __init__(self, what: str) -> None:
        self.what = what
        self.feedback: List[Any] = []
        self.end: Tuple[str, str, str] = ("", "", "")
        self.ended = threading.Event()

    def get_goal(self) -> ListenGoal:
        return ListenGoal(grammar=self.what)

    def set_accepted(self) -> None:
        """It begins."""

    def publish_feedback(self, feedback: Any) -> None:
        self.feedback.append(feedback)

    def _end(self, kind: str, result: Any, text: str) -> None:
        result.serialize(io.BytesIO())
        self.end = kind, result.text, text
        self.ended.set()

    def set_succeeded(self, result: Any, text: str) -> None:
        self._end("succeeded", result, text)

    def set_aborted(self, result: Any, text: str) -> None:
        self._end("aborted", result, text)

    def set_canceled(self, result: Any, text: str) -> None:
        self._end("preempted", result, text)


class Hear(smach.State):
    """Sets the result as the goal says."""

    def __init__(self) -> None:
        super().__init__(outcomes=["done"], input_keys=["what"], output_keys=["heard"])

    def execute(self, ud: Any) -> str:
        if ud.what == "exit":
            raise SystemExit(3)
        ud.heard = 5 if ud.what == "number" else ud.what
        return "done"


@pytest.fixture
def wrapper(monkeypatch: pytest.MonkeyPatch) -> ActionServerWrapper:
    server = SimpleNamespace(start=lambda: None)
    monkeypatch.setattr(action_server_wrapper.actionlib, "ActionServer", lambda *_, **__: server)
    monkeypatch.setattr(rospy, "logerr", lambda text: None)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    machine = smach.StateMachine(["done"], input_keys=["what"], output_keys=["heard"])
    with machine:
        smach.StateMachine.add("HEAR", Hear())
    made = ActionServerWrapper(
        "listen",
        ListenAction,
        machine,
        succeeded_outcomes=["done"],
        goal_slots_map={"grammar": "what"},
        result_slots_map={"text": "heard"},
    )
    made.run_server()
    return made


@pytest.mark.parametrize(("what", "why"), [("number", "field text must be"), ("exit", "SystemExit: 3")])
def test_a_goal_whose_end_cannot_be_sent_is_aborted_and_keeps_no_next_one(
    wrapper: ActionServerWrapper, what: str, why: str
) -> None:
    bad, good = Goal(what), Goal("good")
    wrapper._receive_goal(bad)
    assert bad.ended.wait(LONG), "never answered"
    assert bad.end[0] == "aborted" and why in bad.end[2]
    wrapper._receive_goal(good)
    assert good.ended.wait(LONG), "the next goal was never answered"
    assert good.end[:2] == ("succeeded", "good")
