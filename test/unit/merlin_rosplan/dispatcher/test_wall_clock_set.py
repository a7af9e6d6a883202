# SPDX-License-Identifier: Apache-2.0
"""A dispatcher on a robot whose clock is set: no time of its plan comes earlier or later."""

import queue
from types import SimpleNamespace
from typing import Any, Iterator

import pytest
import rospy
from fakes.topics import Topics

from merlin_pddl.breakpoints import Breakpoints
from merlin_ros import ros_alarm
from merlin_rosplan.dispatcher.dispatch_topics import DispatchTopics
from merlin_test import LONG

HOUR = 3600.0


class Robot:
    """The world of a dispatcher.

    :ivar ros: ROS time, s, which is the wall's.
    :ivar monotonic: the clock that is not set, s.
    :ivar rings: a tick each time that the dispatcher is woken.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ros, self.monotonic = 100_000.0, 50.0
        self.rings: queue.Queue[bool] = queue.Queue()
        self._looks: queue.Queue[float] = queue.Queue()
        self.parts: list = []
        Topics(monkeypatch)
        monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: True)
        monkeypatch.setattr(rospy, "get_time", lambda: self.ros)
        monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time.from_sec(self.ros))
        monkeypatch.setattr(ros_alarm, "time", SimpleNamespace(monotonic=self._look))
        monkeypatch.setattr(ros_alarm, "LONGEST", 0.02)  # the alarm looks again and again
        changes = [(self.ros + 10.0, "open")]
        knowledge: Any = SimpleNamespace(timed_changes=lambda: changes)
        component: Any = SimpleNamespace(
            scope="/dispatcher",
            knowledge_base="/kb",
            closed=False,
            param=lambda name, default: default,
            resolve=lambda name: f"/dispatcher/{name}",
            own=lambda part: self.parts.append(part) or part,
            publisher=rospy.Publisher,
            subscriber=rospy.Subscriber,
        )
        ignored: Any = SimpleNamespace
        self.topics = DispatchTopics(
            component, lambda: knowledge, False, lambda: self.rings.put(True), ignored, ignored, Breakpoints()
        )

    def _look(self) -> float:
        self._looks.put(self.monotonic)
        return self.monotonic

    def wait_looks(self) -> None:
        """The alarm has looked at the present time and has decided."""
        for _ in range(2):
            while self._looks.get(timeout=LONG) != self.monotonic:
                pass

    def set(self, step: float, passed: float) -> None:
        """The clock is set, and so much passes."""
        self.monotonic += passed
        self.ros += passed + step


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    made = Robot(monkeypatch)
    yield made
    for part in made.parts:
        part.shutdown()


@pytest.mark.parametrize("step", [HOUR, -HOUR])
def test_a_start_waits_for_its_time_and_no_longer(robot: Robot, step: float) -> None:
    begun = robot.topics.now()
    robot.topics.wake_at(begun + 5.0)
    robot.set(step, 4.0)
    assert robot.topics.now() - begun == 4.0
    robot.wait_looks()
    assert robot.rings.empty()
    robot.set(0.0, 1.1)
    assert robot.rings.get(timeout=LONG)


@pytest.mark.parametrize(("step", "left"), [(0.0, 8.0), (5.0, 3.0), (-HOUR, HOUR + 8.0), (HOUR, None)])
def test_what_waits_for_a_moment_comes_with_the_clock_as_it_was_set(
    robot: Robot, step: float, left: Any
) -> None:
    robot.set(step, 2.0)
    now = robot.topics.now()
    due = robot.topics.next_change(frozenset(["open"]), now + 2 * HOUR)
    assert (None if due is None else due - now) == left
