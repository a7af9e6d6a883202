# SPDX-License-Identifier: Apache-2.0
"""What a robot says of itself in its fleet, and how it obeys a stop from there."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List, Tuple

import pytest
import rospy
import tf2_ros
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import ExecutorStatus, GuardStatus, RunningAction

from merlin_fleet.core.records import STATUS, Halt, Status
from merlin_fleet.node import robot_report
from merlin_fleet.node.executor_body import NO_EXECUTOR
from merlin_fleet.node.robot_report import RobotReport, own_page
from merlin_ros.master.master_link import ERRORS
from merlin_test import LONG

HELD = "the base is held by Ana since 0.0 s"


class Robot:
    """A robot as topics, transforms and parameters."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.changed = threading.Condition()  # guards the field below
        self.said: List[Status] = []
        self.alive = True
        self.at: Any = (1.0, 2.04)
        self.stamp = 0.0
        self.order: List[str] = []  # what a stop does
        self.answers = True  # the guard does
        self.held = ""  # what the guard says of it
        self.parameters: Dict[str, Any] = {"/world/points_of_interest": {"hall": {"x": 1.5, "y": 2.0}}}
        self._receive: Dict[str, Callable[[Any], None]] = {}
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(rospy, "Publisher", lambda *_, **__: self)
        monkeypatch.setattr(rospy, "get_param", lambda name, default: default)
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(rospy, "get_time", lambda: 100.0)
        monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
        monkeypatch.setattr(robot_report, "RosSystem", lambda: self)
        monkeypatch.setattr(robot_report, "RobotGuards", lambda: self)
        monkeypatch.setattr(robot_report, "bounded_master", lambda: self)
        monkeypatch.setattr(robot_report, "LOOK", 0.02)
        self.namespace = "/"
        self.report = RobotReport("merlin/execute", lambda: self.alive, "", self._take)
        self.report.start()

    def _subscribe(self, topic: str, _: Any, receive: Callable[[Any], None], **__: Any) -> None:
        self._receive[topic] = receive

    def _take(self, kind: str, status: Status) -> None:
        assert kind == STATUS
        with self.changed:
            self.said.append(status)
            self.changed.notify_all()

    def until(self, holds: Callable[[Status], bool]) -> Status:
        """Waits until the last status is as wanted."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.said and holds(self.said[-1]), LONG), self.said[-1:]
            return self.said[-1]

    def say(self, topic: str, message: Any) -> None:
        """A topic says something."""
        self._receive[topic](message)

    # --- as transforms, master, publisher and guards have it

    def transforms(self) -> Callable[[str, str], Any]:
        def newest(target: str, source: str) -> Any:
            if self.at is None:
                raise tf2_ros.TransformException("there is none")
            found = SimpleNamespace(x=self.at[0], y=self.at[1])
            header = SimpleNamespace(stamp=SimpleNamespace(to_sec=lambda: self.stamp))
            return SimpleNamespace(transform=SimpleNamespace(translation=found), header=header)

        return newest

    def getParam(self, name: str) -> Any:
        if name not in self.parameters:
            raise ERRORS[0]("there is no such parameter")
        return self.parameters[name]

    def publish(self, _: Any) -> None:
        self.order.append("cancel")

    def stop(self, by: str) -> None:
        self.order.append(f"stop by {by}")

    def wait_held(self, limit: float = 1.0) -> Dict[str, bool]:
        if self.answers and limit:
            self.held = HELD  # the report hears of it when all that waits for it has heard
        return {"": bool(self.held)}

    def holders_now(self) -> str:
        return self.held

    def confirm(self, held: str) -> None:
        """The guard says that it holds the base, or does not."""
        self.held = held
        state = GuardStatus.STOPPED if held else GuardStatus.IDLE
        self.say("merlin/guard", GuardStatus(state=state, reason=held))


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    made = Robot(monkeypatch)
    yield made
    made.report.close()


def test_it_says_what_it_does_and_where(robot: Robot) -> None:
    running = [RunningAction(name="navigate", parameters=[KeyValue("from", "hall"), KeyValue("to", "bath")])]
    status = ExecutorStatus(state=ExecutorStatus.RUNNING, goals=["(checked bath)"], stage="DISPATCH_PLAN")
    status.running = running
    robot.say("merlin/status", status)
    said = robot.until(lambda said: bool(said.doing))
    assert (said.doing, said.goals) == (("navigate from=hall to=bath",), ("(checked bath)",))
    assert (said.place, said.x, said.y) == ("hall", 1.0, 2.0)
    assert said.at > 0.0
    robot.at = (7.0, 2.0)
    assert robot.until(lambda said: said.x == 7.0).place == "", "no point of interest is near"
    robot.say("merlin/status", ExecutorStatus(state=ExecutorStatus.IDLE))
    assert robot.until(lambda said: not said.doing).stage == ""


def test_what_is_not_known_is_not_said(robot: Robot) -> None:
    robot.say("merlin/status", ExecutorStatus(state=ExecutorStatus.RUNNING, stage="PLAN"))
    robot.until(lambda said: said.stage == "PLAN")
    robot.alive = False
    assert robot.until(lambda said: said.trouble == NO_EXECUTOR).stage == ""
    robot.stamp = 90.0  # 10 s ago
    robot.until(lambda said: said.x is None)
    robot.stamp = 99.0
    robot.until(lambda said: said.x == 1.0)
    robot.at = None
    robot.until(lambda said: said.x is None)


def stopped(robot: Robot) -> Tuple[List[str], threading.Event]:
    """Stops the robot; what it has said when it calls the stop obeyed, and whether it does."""
    holds: List[str] = []
    done = threading.Event()
    robot.report.halt(Halt("Ana", 5.0, 17), lambda: (holds.append(robot.said[-1].hold), done.set())[0])
    return holds, done


def test_a_stop_is_obeyed_when_the_status_says_how_the_guard_holds(robot: Robot) -> None:
    holds, done = stopped(robot)
    assert done.wait(LONG)
    assert robot.order == ["stop by Ana", "cancel"]
    assert holds == [HELD]
    assert robot.said[-1].stop == 17
    assert robot.report.unfit() == HELD, "it takes no goals meanwhile"


def test_a_stop_is_not_obeyed_before_the_guard_confirms_it(robot: Robot) -> None:
    robot.answers = False
    _, done = stopped(robot)
    assert robot.until(lambda said: said.stop == 17).hold == ""
    robot.confirm("")  # it is back, and has not heard of the stop yet
    assert not done.is_set()
    robot.confirm(HELD)
    assert done.is_set()
    robot.until(lambda said: said.hold == HELD)


def test_of_two_stops_the_newest_one_counts_whichever_is_answered_last(robot: Robot) -> None:
    waiting: List[threading.Thread] = []
    waits, go_on = threading.Event(), threading.Event()

    def wait_held(limit: float = 1.0) -> Dict[str, bool]:
        if limit:
            waiting.append(threading.current_thread())
            waits.set()
            if len(waiting) == 1:
                assert go_on.wait(LONG)
        return {"": bool(robot.held)}

    robot.wait_held = wait_held  # type: ignore[method-assign]
    obeyed: List[int] = []
    for revision in (17, 18):
        robot.report.halt(Halt("Ana", 5.0, revision), lambda obeys=revision: obeyed.append(obeys))
        assert waits.wait(LONG)
    robot.until(lambda said: said.stop == 18)
    go_on.set()
    waiting[0].join(LONG)
    assert robot.said[-1].stop == 18
    robot.confirm(HELD)
    assert obeyed == [18]


def test_a_guard_that_says_nothing_more_confirms_nothing(robot: Robot) -> None:
    robot.confirm(HELD)
    robot.until(lambda said: bool(said.hold))
    robot.held = ""
    robot.until(lambda said: not said.hold)


@pytest.mark.parametrize(
    ("executor", "why"),
    [
        (ExecutorStatus(paused=True), "its Executor is paused"),
        (ExecutorStatus(held="(in_service)"), "its Executor is held before (in_service)"),
    ],
)
def test_it_takes_no_goals_that_its_executor_does_not_begin(
    robot: Robot, executor: ExecutorStatus, why: str
) -> None:
    assert robot.report.unfit() == ""
    executor.stage = "DISPATCH_PLAN"
    executor.state = ExecutorStatus.RUNNING
    robot.say("merlin/status", executor)
    assert robot.report.unfit() == why
    assert robot.until(lambda said: bool(said.stage)).hold == "", "it says nothing of the base"
    robot.alive = False
    assert robot.report.unfit() == "", "an Executor that is gone has said this"


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("http://127.0.0.1:8080/", ""),
        ("http://localhost:8080/", ""),
        ("http://[::1]:8080/", ""),
        ("http://[robot.lab:8080/", ""),
        ("", ""),
        ("https://robot.lab:8080/", "https://robot.lab:8080/"),
    ],
)
def test_only_a_page_that_others_reach_is_named(address: str, shown: str) -> None:
    assert own_page(address) == shown
