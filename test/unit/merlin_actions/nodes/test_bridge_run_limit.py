# SPDX-License-Identifier: Apache-2.0
"""A bridge stops an action that hangs after its limit, also where the clock is set back meanwhile."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, Optional

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from fakes.dispatched import Dispatcher
from merlin_msgs.msg import RunActionResult
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions import merlin_action
from merlin_actions.merlin_action import MerlinAction
from merlin_planning.action_messages import answer_in

DAY = 24 * 3600.0


class Host:
    """The client of a machine that ends when it is cancelled only.

    :ivar thread: of the action that was sent.
    """

    name = "/actions/deliver"
    parameter = ""
    thread: Optional[threading.Thread] = None

    def robot(self, binding: Any) -> str:
        return ""

    def param(self, robot: str) -> str:
        return "actions/deliver"

    def client(self, robot: str) -> "Host":
        return self

    def wait_for_server(self, limit: float, stopped: Callable[[], bool]) -> bool:
        return True

    def send(self, *_: Any, **__: Any) -> Any:
        sent = SimpleNamespace(done=False, status=GoalStatus.ACTIVE, text="", result=RunActionResult())
        sent.cancel = lambda: vars(sent).update(done=True, status=GoalStatus.PREEMPTED)
        self.thread = threading.current_thread()
        return sent


def test_an_action_that_hangs_is_stopped_though_the_clock_was_set_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    host, looks = Host(), iter([2 * DAY, DAY])  # at its begin, and then

    def now() -> rospy.Time:
        nonlocal last
        if threading.current_thread() is host.thread:
            last = next(looks, last + 20.0)
        return rospy.Time.from_sec(last)

    last = 2 * DAY
    dispatcher = Dispatcher(monkeypatch)
    monkeypatch.setattr(merlin_action, "ActionServers", lambda *_: host)
    monkeypatch.setattr(rospy.Time, "now", now)
    bridge = MerlinAction("navigate", run_limit=10.0)
    bridge.start()
    dispatcher.wait_announced()
    dispatcher.dispatch(2)
    end = dispatcher.end()
    bridge.shutdown()
    assert end.status == ActionFeedback.ACTION_FAILED
    assert "did not end within 10 s and was stopped" in str(answer_in(end))
