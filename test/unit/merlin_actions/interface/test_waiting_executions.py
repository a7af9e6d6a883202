# SPDX-License-Identifier: Apache-2.0
"""Executions that wait for each other: what is in the way has the robot's time to end, and no more."""

import queue
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List

import pytest
import rospy
from fakes.dispatched import Dispatcher

from merlin_actions import action_interface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_ros import ros_alarm
from merlin_test import LONG

LIMIT = action_interface.WAIT_LIMIT


class Probe(action_interface.ActionInterface):
    """Runs one action at a time, until the test ends it."""

    def __init__(self) -> None:
        super().__init__("navigate")
        self.ends: Dict[int, threading.Event] = {}
        self.running: queue.Queue[int] = queue.Queue()

    def run(self, execution: Execution) -> Ending:
        action = execution.key[1]
        over = self.ends[action] = threading.Event()
        execution.interruptible(over.set)
        self.running.put(action)
        assert over.wait(LONG)
        return Ending(True)


class World:
    """Time of the test's own, and one action after the other.

    :ivar ros: s of ROS time.
    """

    def __init__(self, dispatcher: Dispatcher, interface: Probe) -> None:
        self.dispatcher, self.interface = dispatcher, interface
        self.ros = 100.0
        self.limits: queue.Queue[Callable[[], object]] = queue.Queue()  # that have not passed

    def dispatch(self, *actions: int) -> None:
        """The first one of them runs."""
        for action in actions:
            self.dispatcher.dispatch(action)
        self.runs(actions[0])

    def runs(self, action: int) -> None:
        assert self.interface.running.get(timeout=LONG) == action

    def pass_limit(self, ros: float) -> None:
        """A limit of running time passes, and meanwhile so many s of ROS time."""
        over = self.limits.get(timeout=LONG)
        self.ros += ros
        over()

    def stuck(self, action: int) -> None:
        """The next final answer is the refusal of an action."""
        answer = self.dispatcher.end()
        assert answer.action_id == action
        assert "does not end" in answer.information[0].value


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Iterator[World]:
    made: List[World] = []
    dispatcher = Dispatcher(monkeypatch)
    monkeypatch.setattr(rospy, "get_time", lambda: made[0].ros)
    monkeypatch.setattr(action_interface, "call_when_passed", lambda s, call: made[0].limits.put(call))
    interface = Probe()
    made.append(World(dispatcher, interface))
    interface.start()
    dispatcher.wait_announced()
    yield made[0]
    interface.shutdown()


@pytest.mark.parametrize("factor", [1.0, 30.0])
def test_one_that_is_in_the_way_for_too_long_is_stuck(world: World, factor: float) -> None:
    world.dispatch(1, 2)
    world.pass_limit(factor * LIMIT)
    world.stuck(2)


def test_in_a_slow_simulation_it_has_as_long_by_the_clock_of_that(world: World) -> None:
    world.dispatch(1, 2)
    world.pass_limit(0.4 * LIMIT)
    world.pass_limit(0.4 * LIMIT)
    world.pass_limit(0.4 * LIMIT)
    world.stuck(2)


def test_while_the_clock_stands_the_wait_has_an_end(world: World) -> None:
    world.dispatch(1, 2)
    for _ in range(action_interface.WAITS):
        world.pass_limit(0.0)
    world.stuck(2)


def test_a_wall_clock_that_is_set_back_prolongs_no_wait(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    passed = [50.0]
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: True)
    monkeypatch.setattr(ros_alarm, "time", SimpleNamespace(monotonic=lambda: passed[0]))
    world.dispatch(1, 2)
    passed[0] += LIMIT
    world.pass_limit(-60.0)
    world.stuck(2)


def test_what_has_begun_meanwhile_goes_on(world: World) -> None:
    world.dispatch(1, 2)
    world.interface.ends[1].set()
    world.runs(2)
    world.pass_limit(LIMIT)
    assert world.dispatcher.end().action_id == 1
    world.interface.ends[2].set()
    assert world.dispatcher.end().action_id == 2


def test_each_one_in_the_way_has_that_long(world: World) -> None:
    world.dispatch(1, 2, 3)
    world.interface.ends[1].set()
    world.runs(2)
    world.pass_limit(LIMIT)  # of the second one
    world.pass_limit(0.0)
    world.pass_limit(LIMIT)
    assert world.dispatcher.end().action_id == 1
    world.stuck(3)
