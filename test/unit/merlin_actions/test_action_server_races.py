"""The server of a machine, when a goal ends in the moment in which it is preempted, or cannot be answered."""

import threading
from types import SimpleNamespace
from typing import Any, List
from unittest import mock

import pytest
from diagnostic_msgs.msg import KeyValue

from merlin_actions import merlin_action_server
from merlin_actions.merlin_action_server import MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.merlin_state import SUCCEEDED, MerlinState

LONG = 60.0


class Wait(MerlinState):
    """Runs until a test lets it go on, or it is preempted."""

    def __init__(self) -> None:
        super().__init__()
        self.begun = threading.Event()
        self.goes_on = threading.Event()

    def run(self, userdata: Any) -> str:
        self.interruptible(self.goes_on.set)
        self.begun.set()
        assert self.goes_on.wait(LONG)
        self.interruptible(None)
        self.goes_on.clear()
        return "preempted" if self.preempt_requested() else SUCCEEDED


class Drive(MerlinActionSM):
    parameters = ["to"]

    def build(self) -> None:
        self.waits = Wait()
        self.add("WAIT", self.waits)


class Goal:
    """A goal of the action server, and how it was answered."""

    def __init__(self, name: str, fails: bool = False) -> None:
        self.id = name
        self.goal = SimpleNamespace(parameters=[KeyValue("to", "hall")])
        self.cancel_requested = False
        self.cancel_reason = "cancelled"
        self.answers: List[str] = []
        self.ended = threading.Event()
        self._fails = fails

    def accept(self) -> bool:
        """It begins, unless it was answered."""
        return not self.answers

    def request_cancel(self, reason: str) -> None:
        self.cancel_requested, self.cancel_reason = True, reason

    def feedback(self, feedback: Any) -> None:
        """Its machine is in another state."""

    def _answer(self, how: str) -> None:
        self.answers.append(how)
        self.ended.set()
        if self._fails:
            raise ValueError("this cannot be told")

    def succeed(self, *_: Any) -> None:
        self._answer("succeeded")

    def cancelled(self, *_: Any) -> None:
        self._answer("preempted")

    def abort(self, *_: Any) -> None:
        self._answer("aborted")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> MerlinActionServer:
    shown = SimpleNamespace(stop=lambda: None)
    monkeypatch.setattr(merlin_action_server, "start_introspection", lambda name, machine: shown)
    return MerlinActionServer(Drive(), 0.0)


def test_a_goal_that_has_ended_meanwhile_is_not_preempted(server: MerlinActionServer) -> None:
    goal = Goal("a")
    server._receive(goal)  # type: ignore[arg-type]
    waits = server.machine.waits  # type: ignore[attr-defined]
    assert waits.begun.wait(LONG)
    with server._changed:
        late = server._book.cancel(goal.id, "cancelled")
    waits.goes_on.set()
    assert goal.ended.wait(LONG)
    server._carry_out(late)
    assert goal.answers == ["succeeded"] and not goal.cancel_requested


def test_a_goal_is_preempted_before_it_has_its_machine(server: MerlinActionServer) -> None:
    goal = Goal("a")
    with server._changed:
        server._goals[goal.id] = goal  # type: ignore[assignment]
        begins = server._book.arrive(goal.id)
        stops = server._book.cancel(goal.id, "a newer goal takes its place")
    server._carry_out(stops)
    server._carry_out(begins)
    assert goal.ended.wait(LONG)
    assert goal.answers == ["preempted"] and goal.cancel_reason == "a newer goal takes its place"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_goal_that_cannot_be_answered_does_not_keep_the_next_one(server: MerlinActionServer) -> None:
    first, second = Goal("a", fails=True), Goal("b")
    server._receive(first)  # type: ignore[arg-type]
    waits = server.machine.waits  # type: ignore[attr-defined]
    assert waits.begun.wait(LONG)
    waits.begun.clear()
    run = server._threads["a"]
    server._receive(second)  # type: ignore[arg-type]
    assert first.ended.wait(LONG)
    run.join(LONG)
    assert waits.begun.wait(LONG), "the next goal never began"
    waits.goes_on.set()
    assert second.ended.wait(LONG)
    assert second.answers == ["succeeded"]


def test_a_machine_that_cannot_begin_is_answered_and_keeps_no_next_goal(
    server: MerlinActionServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(merlin_action_server.rospy, "logerr", lambda text: None)
    first, second = Goal("a"), Goal("b")
    with monkeypatch.context() as broken:
        broken.setattr(threading.Thread, "start", mock.Mock(side_effect=RuntimeError("no more threads")))
        server._receive(first)  # type: ignore[arg-type]
    assert first.answers == ["aborted"]
    server._receive(second)  # type: ignore[arg-type]
    waits = server.machine.waits  # type: ignore[attr-defined]
    assert waits.begun.wait(LONG), "the next goal never began"
    waits.goes_on.set()
    assert second.ended.wait(LONG)
    assert second.answers == ["succeeded"]


def test_a_goal_that_was_answered_while_it_waited_does_not_run(
    server: MerlinActionServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = Goal("a"), Goal("b")
    server._receive(first)  # type: ignore[arg-type]
    waits = server.machine.waits  # type: ignore[attr-defined]
    assert waits.begun.wait(LONG)
    waits.begun.clear()
    run = server._threads["a"]
    monkeypatch.setattr(server.machine, "cancel", lambda: None)
    server._receive(second)  # type: ignore[arg-type]
    second.abort()
    waits.goes_on.set()
    run.join(LONG)
    assert not server._book.running and not waits.begun.is_set()


class Odd(MerlinState):
    """Gives up, and says of itself what is no text."""

    def run(self, userdata: Any) -> str:
        if userdata.to == "error":
            return self.give_up(ValueError("there is no cup"))  # type: ignore[arg-type]
        self.unstopped = ["the arm"]  # type: ignore[assignment]
        self.given_up = self.reason = 5  # type: ignore[assignment]
        return "aborted"


class Fetch(MerlinActionSM):
    parameters = ["to"]

    def build(self) -> None:
        self.add("ODD", Odd(input_keys=["to"]))


@pytest.mark.parametrize("kind", ["error", "other"])
def test_a_state_that_ends_with_what_is_no_text_is_answered_and_keeps_no_next_goal(
    server: MerlinActionServer, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.setattr(merlin_action_server.rospy, "logerr", lambda text: None)
    monkeypatch.setattr("merlin_sm.merlin_sm.rospy.loginfo", lambda text: None)
    fetch = MerlinActionServer(Fetch(), 0.0)
    for name in ("a", "b"):
        goal = Goal(name)
        goal.goal.parameters[0].value = kind
        fetch._receive(goal)  # type: ignore[arg-type]
        assert goal.ended.wait(LONG), "never answered"
        assert goal.answers == ["aborted"]


def test_a_machine_is_preempted_where_no_thread_can_be_started(
    server: MerlinActionServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    goal = Goal("a")
    server._receive(goal)  # type: ignore[arg-type]
    assert server.machine.waits.begun.wait(LONG)  # type: ignore[attr-defined]
    refuse = mock.Mock(side_effect=RuntimeError("can't start new thread"))
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threading.Thread, "start", refuse)
        server._cancel(goal)  # type: ignore[arg-type]
    assert goal.ended.wait(LONG)
    assert goal.answers == ["preempted"]
