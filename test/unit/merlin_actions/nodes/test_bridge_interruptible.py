# SPDX-License-Identifier: Apache-2.0
"""A bridge publishes at which states of its machine a more urgent request has to wait."""

from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
from actionlib_msgs.msg import GoalStatus
from fakes.dispatched import Dispatcher
from merlin_msgs.msg import RunActionFeedback, RunActionResult
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions import merlin_action
from merlin_actions.merlin_action import MerlinAction
from merlin_planning.action_messages import answer_in
from merlin_planning.dispatch_progress import DispatchAnswer


class Host:
    """The client of a machine that reaches one state after the other, and succeeds."""

    name = "/actions/deliver"

    def __init__(self, *kept: bool) -> None:
        self._kept = kept
        self.parameter = ""
        self.late: Callable[[], None] = lambda: None

    def robot(self, binding: Any) -> str:
        return ""

    def param(self, robot: str) -> str:
        return "actions/deliver"

    def client(self, robot: str) -> "Host":
        return self

    def wait_for_server(self, limit: float, stopped: Callable[[], bool]) -> bool:
        return True

    def send(self, goal: Any, on_done: Any, on_feedback: Any, owner: str) -> Any:
        sent = SimpleNamespace(done=True, status=GoalStatus.SUCCEEDED, text="", result=RunActionResult())
        for kept in self._kept:
            on_feedback(sent, RunActionFeedback("DELIVER/X", kept))
        self.late = lambda: on_feedback(sent, RunActionFeedback("DELIVER/Y", True))
        on_done(sent)
        return sent


@pytest.mark.parametrize(
    ("kept", "changes"),
    [
        ([False, True, True, False, True], ["no", "yes", "no"]),
        ([False, False], []),  # of a class that does not say anything
    ],
)
def test_each_change_is_published_once(
    monkeypatch: pytest.MonkeyPatch, kept: List[bool], changes: List[str]
) -> None:
    host, published = Host(*kept), []  # type: ignore[var-annotated]
    dispatcher = Dispatcher(monkeypatch)
    monkeypatch.setattr(merlin_action, "ActionServers", lambda *_: host)
    monkeypatch.setattr(merlin_action.rospy.Time, "now", lambda: merlin_action.rospy.Time(1))

    def note(topic: str, message: Any) -> None:
        if isinstance(message, ActionFeedback):
            published.append(message)

    dispatcher.topics.before = note
    bridge = MerlinAction("navigate")
    bridge.start()
    dispatcher.wait_announced()
    dispatcher.dispatch(2)
    end = dispatcher.end()
    host.late()  # its feedback came behind the end
    bridge.shutdown()
    taken, *answers, last = published
    assert last is end and end.status == ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
    assert answer_in(taken) == (DispatchAnswer.TAKEN, {})
    assert all((m.plan_id, m.action_id, m.status) == (7, 2, ActionFeedback.ACTION_ENABLED) for m in answers)
    interruptible = [(DispatchAnswer.TAKEN, {"interruptible": each}) for each in changes]
    assert [answer_in(message) for message in answers] == interruptible
