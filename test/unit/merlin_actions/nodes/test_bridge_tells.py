# SPDX-License-Identifier: Apache-2.0
"""A bridge tells the Executor at which states of its machine a more urgent request has to wait."""

from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import RunActionFeedback, RunActionResult
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_interface, merlin_action
from merlin_actions.core.execution import Execution
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

    def client(self, robot: str) -> "Host":
        return self

    def send(self, goal: Any, on_done: Any, on_feedback: Any, owner: str) -> Any:
        sent = SimpleNamespace(done=True, status=GoalStatus.SUCCEEDED, text="", result=RunActionResult())
        for kept in self._kept:
            on_feedback(sent, RunActionFeedback("DELIVER/X", kept))
        self.late = lambda: on_feedback(sent, RunActionFeedback("DELIVER/Y", True))
        on_done(sent)
        return sent


@pytest.mark.parametrize(
    ("kept", "told"),
    [
        ([False, True, True, False, True], ["no", "yes", "no"]),
        ([False, False], []),  # of a class that does not say anything
    ],
)
def test_each_change_is_told_once(monkeypatch: pytest.MonkeyPatch, kept: List[bool], told: List[str]) -> None:
    operator = SimpleNamespace(formula=DomainFormula(name="deliver"))
    knowledge = SimpleNamespace(name="/kb", operator=lambda name: operator)
    host, published = Host(*kept), []  # type: ignore[var-annotated]
    monkeypatch.setattr(action_interface, "knowledge_client", lambda name: knowledge)
    monkeypatch.setattr(action_interface, "effects_of", lambda details, knowledge: None)
    monkeypatch.setattr(action_interface, "publish", lambda publisher, message: published.append(message))
    monkeypatch.setattr(merlin_action, "ActionServers", lambda *_: host)
    monkeypatch.setattr(merlin_action.rospy.Time, "now", lambda: merlin_action.rospy.Time(1))
    bridge = MerlinAction("deliver")
    monkeypatch.setattr(bridge, "_feedback", None, raising=False)
    execution = Execution(ActionDispatch(plan_id=7, action_id=2, name="deliver"), [KeyValue("c", "cup")])
    assert bridge.run(execution).succeeded
    execution.answered = True
    host.late()  # its feedback came behind the end
    assert all((m.plan_id, m.action_id, m.status) == (7, 2, ActionFeedback.ACTION_ENABLED) for m in published)
    answers = [answer_in(message) for message in published]
    assert answers == [(DispatchAnswer.TAKEN, {"interruptible": each}) for each in told]
