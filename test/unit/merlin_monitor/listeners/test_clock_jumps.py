# SPDX-License-Identifier: Apache-2.0
"""Durations are right when the computer's clock is set while something runs."""

import threading
import time
from typing import Any, Callable, Dict, Iterator, List

import genpy
import pytest
import rospy
from merlin_msgs.msg import DispatchStatus, ExecuteActionResult, ExecutorStatus
from messages import dispatch, executor, feedback, running

from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panels.now import NowPanel
from merlin_monitor.panels.plan import PlanPanel
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_steps import ShownStep
from merlin_test import LONG

REQUEST = "/mission-1-1.0"


class System(RosSystem):
    """Topics without ROS; the times are those of a robot."""

    namespace, name = "/", "/monitor"

    def __init__(self) -> None:
        self.receivers: Dict[str, Callable[[Any], object]] = {}

    def parameter(self, name: str, default: Any) -> Any:
        return default

    def subscribe(self, topic: str, message_class: type, receive: Any, **_: Any) -> Any:
        self.receivers[topic.rpartition("/")[2]] = receive
        return self


class Clock:
    """The clock of the computer, which can be set."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self.set_by = 0.0

    def __call__(self) -> float:
        return self._now() + self.set_by


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock(time.time)
    monkeypatch.setattr(time, "time", clock)
    rospy.rostime.set_rostime_initialized(True)
    return clock


class Page:
    """The panels of what runs."""

    def __init__(self) -> None:
        self.system, inbox = System(), Inbox()
        self.state = MonitorModel(inbox)
        self.events: List[Event] = []
        self.state.on_event = self.events.append
        self.panels = [NowPanel(self.state, self.system), PlanPanel(self.state, self.system)]
        inbox.start()

    def hear(self, topic: str, message: Any) -> None:
        """A node of this computer sends a message now."""
        if message._has_header:
            message.header.stamp = genpy.Time.from_sec(rospy.get_time())
        self.system.receivers[topic](message)

    def durations(self, kind: str) -> List[float]:
        """How long what has ended took, s: in words, and as the timeline has it."""
        taken = threading.Event()
        self.state.inbox.put(taken.set)
        assert taken.wait(LONG)
        ended = [event for event in self.events if event.kind == kind and "ended" in event.detail]
        words = [float(event.text.partition(" after ")[2].split()[0]) for event in ended]
        return words + [event.detail["ended"] - event.detail["began"] for event in ended]


@pytest.fixture
def page(clock: Clock) -> Iterator[Page]:
    page = Page()
    yield page
    page.state.inbox.stop()


@pytest.mark.parametrize("jump", [-3600.0, 3600.0])
def test_a_request_lasts_as_long_as_it_does(page: Page, clock: Clock, jump: float) -> None:
    page.hear("status", executor(ExecutorStatus.RUNNING, request=REQUEST, goals=["(a)"]))
    clock.set_by = jump
    result = ExecuteActionResult()
    result.status.goal_id.id = REQUEST
    page.hear("result", result)
    durations = page.durations("goal")
    assert len(durations) == 2 and all(-0.01 <= each < LONG for each in durations), durations


@pytest.mark.parametrize("jump", [-3600.0, 3600.0])
def test_so_does_a_step_also_one_whose_begin_only_the_dispatcher_knows(
    page: Page, clock: Clock, jump: float
) -> None:
    steps = [ShownStep(number, "wait", [("s", str(number))], 0.0, 1.0) for number in (0, 1)]
    page.state.inbox.put(page.state.plan.planned, steps, [], page.system.time())
    page.hear("action_dispatch", dispatch(0, "wait", ("s", "0")))
    clock.set_by = jump
    other = running(1, "wait", ("s", "1"))
    other.dispatched = genpy.Time.from_sec(rospy.get_time() - 5.0)
    page.hear("dispatch_status", DispatchStatus(state=DispatchStatus.RUNNING, steps_total=2, running=[other]))
    for number in (0, 1):
        page.hear("action_feedback", feedback(number, 4))
    first, second, *shown = page.durations("action")
    assert -0.01 <= first < LONG and 4.9 <= second < LONG, (first, second)
    assert shown == pytest.approx([first, second], abs=0.06)


def test_a_message_that_was_on_its_way_while_the_clock_was_put_back_came_at_once(
    page: Page, clock: Clock
) -> None:
    message = executor(ExecutorStatus.RUNNING, request=REQUEST)
    message.header.stamp = genpy.Time.from_sec(rospy.get_time())
    before = page.system.time()
    clock.set_by = -3600.0
    assert before - 0.01 <= page.system.time_of(message) <= page.system.time()
