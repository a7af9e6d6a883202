# SPDX-License-Identifier: Apache-2.0
"""A mission survives an operator who stops the robot or cancels its goals, as it has declared."""

import threading
from typing import Any, Callable, List

import pytest
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecuteResult, ExecutorStatus, MissionStatus

from merlin_executor.mission import (
    END,
    SKIP,
    WAIT,
    GoalDispatcher,
    MissionNode,
    MissionSM,
    mission_host,
    mission_node,
)
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_test import LONG

HELD = "the base is held by Ana since 14:03:07"


class Round(GoalDispatcher):
    def __init__(self, on_cancel: str = WAIT) -> None:
        super().__init__("round", on_cancel=on_cancel)

    def run(self) -> None:
        self.achieve("(checked kitchen)")
        self.achieve("(checked bathroom)")


class Tour(MissionSM):
    def __init__(self, on_cancel: str = WAIT) -> None:
        super().__init__("tour", on_cancel=on_cancel)

    def build(self) -> None:
        self.add_goal_state("KITCHEN", "(checked kitchen)", {"succeeded": "BATH"})
        self.add_goal_state("BATH", "(checked bathroom)")


class Nested(Tour):
    def build(self) -> None:
        inner = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
        rooms = ("kitchen", "bathroom")
        kitchen, bath = (
            MerlinStateFactory.create("goals", f"(checked {room})", client=self.client) for room in rooms
        )
        with inner:
            MerlinSM.add("KITCHEN", kitchen, {SUCCEEDED: "BATH"})
            MerlinSM.add("BATH", bath)
        self.add("ROOMS", inner)


MISSIONS = pytest.mark.parametrize("kind", [Round, Tour, Nested])


class Run:
    """A mission in a thread; the goal for the kitchen goes on until someone ends it."""

    def __init__(self, robot: FakeRobot, kind: Callable[[str], MissionNode], on_cancel: str) -> None:
        self._changed = threading.Condition()
        self._robot = robot
        robot.never = ["(checked kitchen)"]
        robot.on_goal = lambda goal: self._notify()
        robot.published = Published(self._notify)  # before the mission takes its publishers
        self.mission = kind(on_cancel)
        self.ended: List[bool] = []
        self._thread = threading.Thread(target=lambda: self.ended.append(self.mission.carry_out()))
        self._thread.start()
        self.wait(lambda: bool(robot.goals))

    def _notify(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def wait(self, predicate: Callable[[], bool]) -> None:
        with self._changed:
            assert self._changed.wait_for(predicate, LONG), (self._robot.goals, list(self._robot.published))

    def wait_paused(self) -> None:
        self.wait(lambda: self._robot.published[-1].state == MissionStatus.PAUSED)

    def end(self) -> bool:
        self._thread.join(LONG)
        return self.ended[0]


class Published(List[Any]):
    def __init__(self, on_message: Callable[[], None]) -> None:
        super().__init__()
        self._on_message = on_message

    def append(self, message: Any) -> None:
        super().append(message)
        self._on_message()


@MISSIONS
def test_after_a_stop_it_waits_for_the_release_and_goes_on_with_the_goal(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, WAIT)
    robot.operator_cancels()  # the hold is heard later than the cancel
    run.wait_paused()
    robot.held(HELD)
    assert robot.goals == ["(checked kitchen)"] and not run.ended
    robot.never = []
    robot.held("")
    assert run.end()
    assert robot.goals == ["(checked kitchen)"] * 2 + ["(checked bathroom)"]
    assert robot.published[-1].state == MissionStatus.SUCCEEDED


@MISSIONS
def test_a_release_that_comes_before_the_end_of_the_cancel_counts(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, WAIT)
    robot.held(HELD, ExecutorStatus.RUNNING)
    robot.held(HELD, ExecutorStatus.CANCELLING)
    robot.held("", ExecutorStatus.CANCELLING)  # the robot still stops
    robot.never = []
    robot.operator_cancels()
    assert run.end()
    assert robot.goals == ["(checked kitchen)"] * 2 + ["(checked bathroom)"]
    assert MissionStatus.PAUSED not in [status.state for status in robot.published]


@MISSIONS
@pytest.mark.parametrize("state", [ExecutorStatus.RUNNING, ExecutorStatus.CANCELLING])
def test_a_release_that_comes_before_the_cancel_is_not_that_of_the_cancel(
    robot: FakeRobot, kind: Any, state: int
) -> None:
    run = Run(robot, kind, WAIT)
    robot.held(HELD, state)
    robot.held("", state)
    robot.held("", ExecutorStatus.RUNNING)  # it goes on, where it made way for a more urgent request, too
    robot.operator_cancels()
    run.wait_paused()
    robot.never = []
    assert robot.services["merlin/mission/resume"](None).success
    assert run.end()
    assert robot.goals == ["(checked kitchen)"] * 2 + ["(checked bathroom)"]


@MISSIONS
def test_another_hold_after_the_release_is_waited_for(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, WAIT)
    for waits in (HELD, "", HELD):
        robot.held(waits, ExecutorStatus.CANCELLING)
    robot.operator_cancels()
    run.wait_paused()
    robot.never = []
    robot.held("")
    assert run.end()
    assert robot.goals == ["(checked kitchen)"] * 2 + ["(checked bathroom)"]


@MISSIONS
def test_after_a_cancel_it_waits_until_it_is_resumed(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, WAIT)
    robot.operator_cancels()
    run.wait_paused()
    robot.never = []
    assert robot.services["merlin/mission/resume"](None).success
    assert run.end()
    assert robot.goals == ["(checked kitchen)"] * 2 + ["(checked bathroom)"]


@MISSIONS
def test_a_release_does_not_end_the_pause_that_another_operator_wants(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, WAIT)
    robot.operator_cancels()
    run.wait_paused()
    assert robot.services["merlin/mission/pause"](None).success
    assert not robot.services["merlin/mission/pause"](None).success, "it is paused already"
    robot.held(HELD)
    robot.never = []
    robot.held("")
    assert robot.services["merlin/mission/resume"](None).success
    assert run.end()
    assert robot.goals == ["(checked kitchen)"] * 2 + ["(checked bathroom)"]


@MISSIONS
def test_it_may_skip_the_goal(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, SKIP)
    robot.operator_cancels()
    assert run.end()
    assert robot.goals == ["(checked kitchen)", "(checked bathroom)"]


@MISSIONS
def test_it_may_end(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, END)
    robot.operator_cancels()
    assert not run.end()
    assert robot.goals == ["(checked kitchen)"]
    assert robot.published[-1].state == MissionStatus.FAILED


@MISSIONS
def test_while_it_waits_it_can_be_cancelled(robot: FakeRobot, kind: Any) -> None:
    run = Run(robot, kind, WAIT)
    robot.operator_cancels()
    run.wait_paused()
    robot.shut_down()
    assert not run.end()
    assert robot.goals == ["(checked kitchen)"]
    assert robot.published[-1].state == MissionStatus.CANCELLED


@MISSIONS
def test_a_word_that_is_none_is_refused(robot: FakeRobot, kind: Any) -> None:
    with pytest.raises(ValueError, match="on_cancel is 'sleep'; it has to be one of wait, skip, end"):
        kind("sleep")


def test_the_node_of_a_mission_that_ends_meanwhile_stays_until_the_release(
    robot: FakeRobot, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: List[str] = []
    reported = threading.Event()

    def tell(text: str, **_: Any) -> None:
        said.append(text)
        reported.set()

    monkeypatch.setattr(mission_node, "print", tell, raising=False)
    monkeypatch.setattr(mission_host, "init_node", lambda name: None)
    monkeypatch.setattr(mission_host, "load_class", lambda path: Round)
    robot.results = {"(checked kitchen)": ExecuteResult(outcome=ExecuteResult.UNSOLVABLE)}
    robot.on_goal = lambda goal: robot.held(HELD)
    codes: List[int] = []
    node = threading.Thread(target=lambda: codes.append(mission_host.main("Round")))
    node.start()
    assert reported.wait(LONG)
    assert not codes and HELD in said[0]
    robot.held("")
    node.join(LONG)
    assert codes == [1]


@MISSIONS
def test_a_cancel_ends_the_wait_for_an_executor(robot: FakeRobot, kind: Any) -> None:
    robot.absent = True
    mission, ended = kind(WAIT), []
    thread = threading.Thread(target=lambda: ended.append(mission.carry_out()))
    thread.start()
    assert robot.awaited.wait(LONG)
    mission.cancel()
    thread.join(LONG)
    assert ended == [False] and robot.goals == []
    assert robot.published[-1].state == MissionStatus.CANCELLED
