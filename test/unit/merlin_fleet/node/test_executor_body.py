# SPDX-License-Identifier: Apache-2.0
"""The body of a robot: goals of the fleet at its Executor, their end, their stop, and why it does not bid."""

import threading
from typing import Any, Callable, Dict, List, Optional, Tuple

from fake_robot import Ended
from merlin_msgs.msg import ExecuteResult

from merlin_executor.core.standstill import Halt
from merlin_fleet.core.records import Goal
from merlin_fleet.node.executor_body import HALT_TIME, NO_EXECUTOR, ExecutorBody
from merlin_test import LONG

GOAL = Goal("g1", ("(checked kitchen)", "(in_service)"), 0.0)


class FakeExecutor:
    """Takes requests and keeps them until the test ends them."""

    def __init__(self) -> None:
        self.executor_alive = True
        self.begins = False
        self.sent: List[Tuple[List[str], int]] = []
        self.cancels = 0
        self.refusal: Optional[Exception] = None
        self.request: Optional[Ended] = None

    def wait_for_executor(self, timeout: float) -> bool:
        return self.begins

    def send(self, goals: List[str], priority: int, on_done: Callable[[Any], None]) -> Ended:
        if self.refusal is not None:
            raise self.refusal
        self.sent.append((goals, priority))
        self.request = Ended(on_done, lambda _: self._cancel())
        return self.request

    def _cancel(self) -> None:
        self.cancels += 1


class FixedCosts:
    """Every goal costs the same."""

    def cost(self, goal: Goal, behind: Tuple[Goal, ...]) -> Tuple[Optional[float], str]:
        return 7.0 * (1 + len(behind)), ""


class Robot:
    """A body over a fake Executor, and its reports."""

    def __init__(self, stop_time: float = LONG) -> None:
        self.executor = FakeExecutor()
        self.halted = threading.Event()
        self.unfit = ""
        self.ends: List[Tuple[bool, str, str]] = []
        self.body = ExecutorBody(
            self.executor,  # type: ignore[arg-type]
            FixedCosts(),
            self._halt,
            stop_time,
            priority=3,
            unfit=lambda: self.unfit,
        )

    def _halt(self) -> Halt:
        self.halted.set()
        return Halt(True, True)

    def begin(self) -> None:
        self.body.begin(GOAL, lambda achieved, outcome, reason: self.ends.append((achieved, outcome, reason)))

    def end(self, **result: Any) -> None:
        assert self.executor.request is not None
        self.executor.request.end(ExecuteResult(**result))


def outcomes() -> Dict[int, Tuple[bool, str]]:
    return {
        ExecuteResult.SUCCEEDED: (True, "SUCCEEDED"),
        ExecuteResult.ALREADY_TRUE: (True, "ALREADY_TRUE"),
        ExecuteResult.ACTION_FAILED: (False, "ACTION_FAILED"),
    }


def test_the_goal_is_sent_and_its_end_is_reported() -> None:
    for outcome, (achieved, name) in outcomes().items():
        robot = Robot()
        robot.begin()
        assert robot.executor.sent == [(["(checked kitchen)", "(in_service)"], 3)]
        assert robot.ends == []
        robot.end(outcome=outcome, reason="so it is")
        assert robot.ends == [(achieved, name, "so it is")]


def test_a_stop_cancels_once_and_its_end_is_that_of_the_executor() -> None:
    robot = Robot()
    robot.begin()
    robot.body.stop("g1", "the lease ends")
    robot.body.stop("g1", "cancelled in the fleet")
    assert robot.executor.cancels == 1
    assert robot.ends == []
    robot.end(outcome=ExecuteResult.CANCELLED)
    assert robot.ends == [(False, "CANCELLED", "")]
    assert not robot.halted.is_set()


def test_a_stop_that_takes_too_long_halts_the_base_and_goes_on_waiting() -> None:
    robot = Robot(stop_time=HALT_TIME)
    robot.begin()
    robot.body.stop("g1", "the lease ends")
    assert robot.halted.wait(LONG)
    assert robot.ends == []
    robot.end(outcome=ExecuteResult.CANCELLED)
    assert robot.ends == [(False, "CANCELLED", "")]


def test_a_stop_without_a_goal_does_nothing() -> None:
    robot = Robot()
    robot.body.stop("g1", "")
    assert robot.executor.cancels == 0


def test_a_goal_that_cannot_be_sent_has_ended() -> None:
    robot = Robot()
    robot.executor.refusal = ValueError("it is too large")
    robot.begin()
    ((achieved, outcome, reason),) = robot.ends
    assert (achieved, outcome) == (False, "REFUSED")
    assert "it is too large" in reason


def test_it_bids_while_its_executor_answers_and_it_is_fit() -> None:
    robot = Robot()
    assert robot.body.cost(GOAL, (GOAL,)) == (14.0, "")
    robot.unfit = "its battery is at 3 %"
    assert robot.body.cost(GOAL, ()) == (None, "its battery is at 3 %")
    robot.unfit = ""
    robot.executor.executor_alive = False
    assert robot.body.cost(GOAL, ()) == (None, NO_EXECUTOR)
    robot.executor.begins = True
    assert robot.body.cost(GOAL, ()) == (7.0, "")
