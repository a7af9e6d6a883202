# SPDX-License-Identifier: Apache-2.0
"""``merlin/mission`` while a mission is paused, and at the end of a mission that has just begun."""

from typing import Any, Callable, Dict, List, Tuple

import pytest
import rospy
from merlin_msgs.msg import MissionStatus
from rospy import core

from merlin_executor.executor_client import Goals
from merlin_executor.mission import goal_dispatcher, mission_pause, mission_reporter
from merlin_executor.mission.mission_pause import MissionPause
from merlin_executor.mission.mission_reporter import PAUSED_TEXT as PAUSED
from merlin_executor.mission.mission_reporter import MissionReporter
from merlin_planning.knowledge_client import fact
from merlin_sm.states.function_state import FunctionState

RUNNING = MissionStatus.RUNNING
Services = Dict[str, Callable[[Any], Any]]


class Topic:
    """A publisher that keeps what it was given."""

    def __init__(self, *_: Any, **__: Any) -> None:
        self.reported: List[Tuple[int, int, str]] = []
        self.closed = False

    def publish(self, status: MissionStatus) -> None:
        if self.closed:
            raise rospy.ROSException("publish() to a closed topic")
        self.reported.append((status.state, status.task, status.description))


@pytest.fixture()
def topic(monkeypatch: pytest.MonkeyPatch) -> Topic:
    made = Topic()
    monkeypatch.setattr(mission_reporter.rospy, "Publisher", lambda *_, **__: made)
    monkeypatch.setattr(mission_reporter.rospy.Time, "now", rospy.Time)
    return made


@pytest.fixture()
def services(monkeypatch: pytest.MonkeyPatch) -> Services:
    offered: Services = {}

    class Service:
        def __init__(self, name: str, _: Any, handler: Callable[[Any], Any]) -> None:
            offered[name] = handler

        def shutdown(self, reason: str) -> None:
            pass

    monkeypatch.setattr(mission_pause.rospy, "Service", Service)
    return offered


def test_a_mission_that_goes_on_tells_its_task_again(topic: Topic) -> None:
    reporter = MissionReporter("round", 2)
    reporter.task("(checked kitchen)")
    reporter.paused(True)
    reporter.paused(False)
    assert topic.reported == [
        (MissionStatus.STARTING, 0, "starting"),
        (RUNNING, 1, "(checked kitchen)"),
        (MissionStatus.PAUSED, 1, PAUSED),
        (RUNNING, 1, "(checked kitchen)"),
    ]


def test_a_task_that_is_reached_while_paused_does_not_look_as_if_it_ran(topic: Topic) -> None:
    reporter = MissionReporter("evening")
    reporter.task("TABLES")
    reporter.paused(True)
    reporter.task("SERVE")
    assert topic.reported[-1][::2] == (MissionStatus.PAUSED, PAUSED)
    reporter.paused(False)
    assert topic.reported[-1] == (RUNNING, 2, "SERVE")
    reporter.report(MissionStatus.SUCCEEDED, "done")
    assert topic.reported[-1] == (MissionStatus.SUCCEEDED, 2, "done")
    assert reporter.health().message == "done"


def test_the_last_words_of_a_node_that_goes_down_may_be_lost(
    topic: Topic, monkeypatch: pytest.MonkeyPatch
) -> None:
    reporter = MissionReporter("round")
    begin = [(MissionStatus.STARTING, 0, "starting")]
    topic.closed = True
    with pytest.raises(rospy.ROSException):  # a mistake, while the node lives
        reporter.report(MissionStatus.CANCELLED, "cancelled")
    monkeypatch.setattr(core, "_in_shutdown", True)
    reporter.report(MissionStatus.CANCELLED, "cancelled")
    assert topic.reported == begin


class Client:
    """An Executor that is there, and what it was sent."""

    def __init__(self) -> None:
        self.sent: List[str] = []

    def wait_for_executor(self, timeout: float, *_: Any) -> bool:
        return True

    def send(self, goals: str) -> None:
        self.sent.append(goals)

    def cancel_all(self) -> None:
        self.sent.clear()


@pytest.fixture()
def client(monkeypatch: pytest.MonkeyPatch) -> Client:
    made = Client()
    monkeypatch.setattr(goal_dispatcher, "MerlinExecutorClient", lambda **_: made)
    monkeypatch.setattr(goal_dispatcher.rospy, "on_shutdown", lambda hook: None)
    return made


@pytest.mark.parametrize("goals", ["(checked kitchen)", fact("checked", "kitchen")], ids=["text", "item"])
def test_a_mission_that_was_cancelled_sends_no_goal(
    topic: Topic, services: Services, client: Client, goals: Goals
) -> None:
    class Mission(goal_dispatcher.GoalDispatcher):
        def run(self) -> None:
            self.cancel()
            self.achieve(goals)

    assert Mission().execute() is False
    assert client.sent == []
    state, _, said = topic.reported[-1]
    assert (state, said) == (
        MissionStatus.CANCELLED,
        "(checked kitchen): not sent, the mission was cancelled",
    )


@pytest.mark.parametrize("interrupted", [False, True], ids=["returns", "sleep interrupted"])
def test_a_mission_that_ends_after_its_cancel_was_cancelled(
    topic: Topic, services: Services, client: Client, interrupted: bool
) -> None:
    class Mission(goal_dispatcher.GoalDispatcher):
        def run(self) -> None:
            self.cancel()
            if interrupted:
                raise rospy.ROSInterruptException("ROS shutdown request")

    assert Mission().execute() is False
    assert topic.reported[-1][0] == MissionStatus.CANCELLED


def test_a_mission_that_has_ended_is_not_paused(services: Services) -> None:
    reported: List[bool] = []
    with MissionPause(reported.append) as pause:
        assert services["merlin/mission/pause"](None).success
    answers = [service(None) for service in services.values()]
    assert [(answer.success, answer.message) for answer in answers] == [(False, "The mission has ended.")] * 2
    assert reported == [True]
    with pause:  # again, from the beginning
        pause.wait(lambda: False)


def test_a_mission_whose_node_goes_down_before_it_begins_does_nothing(
    topic: Topic, services: Services, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: List[str] = []

    class Mission(goal_dispatcher.MissionSM):
        def build(self) -> None:
            self.add("ACT", FunctionState(lambda userdata: ran.append("ACT")))

    class Server:
        def stop(self) -> None:
            pass

    def down(hook: Callable[[], None]) -> None:
        hook()  # as rospy does once it has shut down

    monkeypatch.setattr(goal_dispatcher, "MerlinExecutorClient", lambda **_: None)
    monkeypatch.setattr(goal_dispatcher, "start_introspection", lambda *_: Server())
    monkeypatch.setattr(goal_dispatcher.node_holds, "offer", lambda: None)
    monkeypatch.setattr(goal_dispatcher.rospy, "on_shutdown", down)
    assert Mission().run() == "preempted"
    assert ran == []
