# SPDX-License-Identifier: Apache-2.0
"""A bridge stops an action that hangs after its limit, and no other one, also where the clock is set."""

import itertools
import threading
from types import SimpleNamespace
from typing import Any, Callable, Iterator, Optional, Tuple

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from fakes.dispatched import Dispatcher
from merlin_msgs.msg import RunActionResult
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions import merlin_action
from merlin_actions.merlin_action import MerlinAction
from merlin_planning.action_messages import answer_in
from merlin_ros import ros_alarm

DAY = 24 * 3600.0


def times(step: float, passes: float) -> Iterator[Tuple[float, float]]:
    """ROS time and the monotonic one, s, at each look; the clock is set after the first, then time passes."""
    yield 2 * DAY, 50.0
    for looks in itertools.count():
        yield 2 * DAY + step + looks * passes, 50.0 + looks * passes


class Host:
    """The client of a machine that ends when it is cancelled, or after some looks at a clock."""

    name = "/actions/deliver"
    parameter = ""

    def __init__(self, looks: Iterator[Tuple[float, float]], ends: int) -> None:
        self._now = next(looks)
        self._looks, self._left = itertools.chain([self._now], looks), ends
        self._thread: Optional[threading.Thread] = None  # of the action that was sent
        self._succeed: Callable[[], object] = lambda: None

    def look(self) -> Tuple[float, float]:
        """A look at one of the clocks."""
        if threading.current_thread() is self._thread:
            self._now, self._left = next(self._looks), self._left - 1
            if self._left == 0:
                self._succeed()
        return self._now

    def robot(self, binding: Any) -> str:
        return ""

    def param(self, robot: str) -> str:
        return "actions/deliver"

    def client(self, robot: str) -> "Host":
        return self

    def wait_for_server(self, limit: float, stopped: Callable[[], bool]) -> bool:
        return True

    def send(self, *_: Any, on_done: Callable[[Any], None], **__: Any) -> Any:
        sent = SimpleNamespace(done=False, status=GoalStatus.ACTIVE, text="", result=RunActionResult())
        sent.cancel = lambda: vars(sent).update(done=True, status=GoalStatus.PREEMPTED)
        done = {"done": True, "status": GoalStatus.SUCCEEDED}
        self._succeed = lambda: (vars(sent).update(done), on_done(sent))
        self._thread = threading.current_thread()
        return sent


def end_of(host: Host, monkeypatch: pytest.MonkeyPatch, wall: bool) -> ActionFeedback:
    dispatcher = Dispatcher(monkeypatch)
    monkeypatch.setattr(merlin_action, "ActionServers", lambda *_: host)
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: wall)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time.from_sec(host.look()[0]))
    monkeypatch.setattr(ros_alarm, "time", SimpleNamespace(monotonic=lambda: host.look()[1]))
    bridge = MerlinAction("navigate", run_limit=10.0)
    bridge.start()
    dispatcher.wait_announced()
    dispatcher.dispatch(2)
    end = dispatcher.end()
    bridge.shutdown()
    return end


@pytest.mark.parametrize("wall", [True, False])
def test_an_action_that_hangs_is_stopped_though_the_clock_was_set_back(
    monkeypatch: pytest.MonkeyPatch, wall: bool
) -> None:
    end = end_of(Host(times(-DAY, 20.0), 0), monkeypatch, wall)
    assert end.status == ActionFeedback.ACTION_FAILED
    assert "did not end within 10 s and was stopped" in str(answer_in(end))


def test_an_action_goes_on_though_the_wall_clock_was_set_forward(monkeypatch: pytest.MonkeyPatch) -> None:
    end = end_of(Host(times(DAY, 4.0), 3), monkeypatch, wall=True)
    assert end.status == ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
