# SPDX-License-Identifier: Apache-2.0
"""The server of a container answers each goal, whatever users' code leaves in the result or raises."""

import enum
import io
import threading
from types import SimpleNamespace
from typing import Any, List, Tuple

import pytest
import rospy
from merlin_msgs.msg import ListenAction, ListenGoal

import smach
from merlin_test import LONG
from smach_ros import action_server_wrapper
from smach_ros.action_server_wrapper import ActionServerWrapper


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


class Unsayable(BaseException):
    def __str__(self) -> str:
        raise AttributeError("users' code, too")


class Hear(smach.State):
    """Sets the result as the goal says."""

    def __init__(self) -> None:
        super().__init__(outcomes=["done"], input_keys=["what"], output_keys=["heard"])

    def execute(self, ud: Any) -> str:
        if ud.what == "exit":
            raise SystemExit(3)
        if ud.what == "unsayable":
            raise Unsayable
        ud.heard = 5 if ud.what == "number" else ud.what
        return "done"


ENDED = "outcome of the container: "


@pytest.fixture
def wrapper(monkeypatch: pytest.MonkeyPatch) -> ActionServerWrapper:
    machine = smach.StateMachine(["done"], input_keys=["what"], output_keys=["heard"])
    with machine:
        smach.StateMachine.add("HEAR", Hear())
    return make_wrapper(monkeypatch, machine, "done")


def make_wrapper(monkeypatch: pytest.MonkeyPatch, machine: Any, succeeded: Any) -> ActionServerWrapper:
    """A running server whose goals the test makes."""
    publisher = SimpleNamespace(impl=SimpleNamespace(connections=[]))
    server = SimpleNamespace(start=lambda: None, result_pub=publisher)
    monkeypatch.setattr(action_server_wrapper.actionlib, "ActionServer", lambda *_, **__: server)
    monkeypatch.setattr(rospy, "logerr", lambda text: None)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    made = ActionServerWrapper(
        "listen",
        ListenAction,
        machine,
        succeeded_outcomes=[succeeded],
        goal_slots_map={"grammar": "what"},
        result_slots_map={"text": "heard"},
    )
    made.run_server()
    return made


@pytest.mark.parametrize(
    ("what", "why"),
    [("number", "field text must be"), ("exit", "SystemExit: 3"), ("unsayable", "Unsayable: ")],
)
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


class Hears(enum.Enum):
    """An outcome."""

    DONE = 0


def test_what_a_goal_answers_is_not_what_the_one_before_left_in_a_nested_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The userdata of a container outlives its runs, the answer does not; outcomes may be members."""

    def hear(userdata: Any) -> Hears:
        runs.append(sorted(inner.userdata.keys()))
        if userdata.what == "first":
            userdata.heard, userdata.place = "first", "hall"
        return Hears.DONE

    runs: List[Any] = []
    keys = {"input_keys": ["what"], "output_keys": ["heard"]}
    inner, outer = smach.StateMachine([Hears.DONE], **keys), smach.StateMachine([Hears.DONE], **keys)
    with outer:
        smach.StateMachine.add("INNER", inner)
        with inner:
            state = smach.CBState(
                hear, outcomes=[Hears.DONE], input_keys=["what"], output_keys=["heard", "place"]
            )
            smach.StateMachine.add("HEAR", state)
    made = make_wrapper(monkeypatch, outer, Hears.DONE)
    for what in ("first", "second"):
        goal = Goal(what)
        made._receive_goal(goal)
        assert goal.ended.wait(LONG)
        assert goal.end == ("succeeded", "first" if what == "first" else "", f"{ENDED}Hears.DONE")
    assert runs == [["what"], ["place", "what"]]
