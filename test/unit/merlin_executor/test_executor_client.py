# SPDX-License-Identifier: Apache-2.0
"""Requests of several threads, and one that cannot wait for a lost Executor."""

import struct
import threading
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import KeyValue
from fakes.topics import Topics
from merlin_msgs.msg import ExecuteAction, ExecuteGoal, ExecuteResult

from merlin_executor import executor_client
from merlin_executor.core.request_limits import RequestTooLarge, check_value
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.goal_check import GoalError
from merlin_executor.mission import GoalDispatcher, goal_dispatcher
from merlin_executor.resending import RESEND
from merlin_ros import service_proxy
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_test import LONG


class Request:
    """A request that has not ended; something happens when that is asked for the first time."""

    def __init__(self) -> None:
        self.cancelled = False
        self.asked: Callable[[], None] = lambda: None

    @property
    def done(self) -> bool:
        asked, self.asked = self.asked, lambda: None
        asked()
        return False

    def leave(self) -> None:
        self.cancelled = True


def test_all_are_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: List[Request] = []

    def request(*_: Any) -> Request:
        sent.append(Request())
        return sent[-1]

    monkeypatch.setattr(executor_client, "ActionClient", lambda *_: SimpleNamespace())
    monkeypatch.setattr(executor_client, "ExecutorRequest", request)
    client = MerlinExecutorClient(knowledge_base=None)
    client.send("(checked hall)")
    other = threading.Thread(target=client.send, args=["(checked door)"], daemon=True)
    sent[0].asked = other.start  # another thread begins while this one takes the next request down
    client.send("(checked kitchen)")
    other.join(LONG)
    client.cancel_all()
    assert [request.cancelled for request in sent] == [True] * 3


class Away:
    """A knowledge base that is being started again."""

    def __init__(self, calls: int) -> None:
        self.calls = calls
        self.asked: Callable[[], None] = lambda: None

    def predicates(self) -> Any:
        self.asked()
        self.calls -= 1
        if self.calls >= 0:
            raise ServiceUnavailable("service /kb/domain/predicates does not answer: its node does not run")
        return {"checked": SimpleNamespace(name="checked", typed_parameters=[KeyValue("p", "object")])}

    def instances(self, type_name: str = "") -> List[str]:
        return ["hall"]


@pytest.fixture
def away(monkeypatch: pytest.MonkeyPatch) -> Away:
    knowledge = Away(calls=3)
    monkeypatch.setattr(service_proxy, "RETRY", 0.0)
    monkeypatch.setattr(executor_client, "ActionClient", lambda *_: SimpleNamespace())
    monkeypatch.setattr(executor_client, "ExecutorRequest", lambda *arguments: arguments[1].goals)
    monkeypatch.setattr(executor_client, "knowledge_client", lambda name: knowledge)
    return knowledge


def test_a_mission_waits_for_a_knowledge_base_that_is_started_again(away: Away) -> None:
    assert MerlinExecutorClient(on_lost=RESEND).send("(checked hall)") == ["(checked hall)"]
    away.calls = 3
    assert MerlinExecutorClient().send("(checked hall)", on_lost=RESEND) == ["(checked hall)"]


def test_a_client_that_waits_for_nothing_learns_it_at_once(away: Away) -> None:
    with pytest.raises(ServiceUnavailable, match="its node does not run"):
        MerlinExecutorClient().send("(checked hall)")
    assert away.calls == 2


@pytest.mark.parametrize("priority", [2**31, -(2**31), 10**30, 1.5])
def test_a_priority_that_no_message_holds_is_named(away: Away, priority: Any) -> None:
    away.calls = 0
    with pytest.raises(RequestTooLarge, match="the priority of the request is .*a whole number from"):
        MerlinExecutorClient().send("(checked hall)", priority=priority)


@pytest.mark.parametrize("value", [1e39, 1e-46, 0.0, -1.0, float("nan"), "high"])
def test_a_value_that_no_message_holds_is_named(away: Away, value: Any) -> None:
    away.calls = 0
    with pytest.raises(RequestTooLarge, match="a number above 0, from 1e-30 to 1e30"):
        MerlinExecutorClient().send("(checked hall)", value=value)


@pytest.mark.parametrize("field", ["on_interrupt", "on_client_lost"])
@pytest.mark.parametrize("choice", [9, -1, "drop"])
def test_a_choice_that_the_message_does_not_know_is_named(away: Away, field: str, choice: Any) -> None:
    away.calls = 0
    with pytest.raises(RequestTooLarge, match=f"{field} of the request is {choice!r}; it has to be one of"):
        MerlinExecutorClient().send("(checked hall)", **{field: choice})


@pytest.mark.parametrize("goals", [5, None, ["(checked hall)", 5]])
def test_goals_that_are_none_are_named(away: Away, goals: Any) -> None:
    with pytest.raises(GoalError, match="goals are PDDL text or knowledge items"):
        MerlinExecutorClient().send(goals)


@pytest.mark.parametrize("value", [1e-30, 1e30])
def test_the_bounds_of_a_value_hold_at_the_executor_too(value: float) -> None:
    (received,) = struct.unpack("<f", struct.pack("<f", value))
    assert check_value(value) == value and check_value(received) == received


def test_a_cancelled_mission_does_not_wait_for_the_knowledge_base(
    away: Away, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Round(GoalDispatcher):
        def run(self) -> None:
            self.achieve("(checked hall)")

    monkeypatch.setattr(goal_dispatcher, "MissionReporter", lambda *_: SimpleNamespace(paused=None))
    mission = Round()
    monkeypatch.setattr(mission.client, "cancel_all", lambda: None)
    away.asked, away.calls = mission.cancel, 10**9
    with pytest.raises(ServiceUnavailable, match="its node does not run"):
        mission.run()
    assert away.calls == 10**9 - 1


@pytest.mark.parametrize("timeout", [float("nan"), 0, -1.0, "soon", True])
def test_a_timeout_that_never_passes_is_refused(
    away: Away, monkeypatch: pytest.MonkeyPatch, timeout: Any
) -> None:
    class Round(GoalDispatcher):
        def run(self) -> None:
            self.achieve("(checked hall)", timeout=timeout)

    monkeypatch.setattr(goal_dispatcher, "MissionReporter", lambda *_: SimpleNamespace(paused=None))
    with pytest.raises(ValueError, match="timeout is .*; it has to be a number of seconds above 0"):
        Round().run()


@pytest.mark.parametrize(
    ("status", "begun"),
    [(GoalStatus.PENDING, False), (GoalStatus.RECALLING, False), (GoalStatus.ACTIVE, True)],
)
def test_a_request_that_the_next_executor_does_not_know_had_begun_when_it_was_active(
    monkeypatch: pytest.MonkeyPatch, clock: Any, status: int, begun: bool
) -> None:
    monkeypatch.setattr(rospy, "get_name", lambda: "/mission")
    topics = Topics(monkeypatch)
    client = ActionClient("merlin/execute", ExecuteAction)
    request = ExecutorRequest(client, ExecuteGoal())
    reported = GoalStatus(goal_id=GoalID(id=request.id), status=status)
    topics.send("/merlin/execute/status", GoalStatusArray(status_list=[reported]))
    topics.send("/merlin/execute/status", GoalStatusArray())  # of another Executor: it knows no goal
    assert request.done and request.result is not None
    assert (request.result.outcome, request.begun) == (ExecuteResult.INTERNAL, begun)
    client.shutdown()


def test_a_request_that_cannot_wait_for_a_lost_executor_ends(
    monkeypatch: pytest.MonkeyPatch, clock: Any
) -> None:
    def no_thread(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(rospy, "get_name", lambda: "/mission")
    topics = Topics(monkeypatch)
    client = ActionClient("merlin/execute", ExecuteAction)
    request = ExecutorRequest(client, ExecuteGoal(), on_lost=RESEND)
    status = GoalStatus(goal_id=GoalID(id=request.id), status=GoalStatus.ACTIVE)
    topics.send("/merlin/execute/status", GoalStatusArray(status_list=[status]))
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threading.Thread, "start", no_thread)
        topics.send("/merlin/execute/status", GoalStatusArray())  # of another Executor: it knows no goal
    assert request.done and request.result is not None
    assert request.result.outcome == ExecuteResult.INTERNAL
    assert "can't start new thread" in request.result.reason
    client.shutdown()


def test_a_program_that_is_interrupted_learns_it_as_from_rospy(
    monkeypatch: pytest.MonkeyPatch, clock: Any
) -> None:
    monkeypatch.setattr(rospy, "get_name", lambda: "/mission")
    Topics(monkeypatch)
    sender = ActionClient("merlin/execute", ExecuteAction)
    monkeypatch.setattr(executor_client, "ActionClient", lambda *_: sender)
    client = MerlinExecutorClient(knowledge_base=None)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: True)
    with pytest.raises(rospy.ROSInterruptException, match="shuts down before its request has ended"):
        client.execute("(checked hall)")
    sender.shutdown()
