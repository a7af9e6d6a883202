# SPDX-License-Identifier: Apache-2.0
"""A naive action carries out one execution after the other, whatever its dispatcher says meanwhile."""

from types import SimpleNamespace
from typing import Any, List

import pytest
from merlin_msgs.msg import DispatchStatus, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_interface
from merlin_actions.core.execution import Execution
from merlin_actions.nodes.naive_action import NaiveAction


class Naive(NaiveAction):
    """Notes what it carries out."""

    def __init__(self) -> None:
        machine: Any = SimpleNamespace(operator_name=lambda: "navigate", check_signature=lambda keys: None)
        super().__init__(machine)
        self.lived: List[str] = []

    def _live(self, execution: Execution) -> None:
        self.lived.append(execution.text)


@pytest.fixture
def naive(monkeypatch: pytest.MonkeyPatch) -> Naive:
    details = SimpleNamespace(formula=DomainFormula(name="navigate"))
    knowledge = SimpleNamespace(name="/kb", operator=lambda name: details)
    monkeypatch.setattr(action_interface, "knowledge_client", lambda name: knowledge)
    monkeypatch.setattr(action_interface, "effects_of", lambda details, knowledge: None)
    return Naive()


def test_an_action_is_carried_out_after_a_status_of_the_dispatcher(naive: Naive) -> None:
    naive._note_dispatcher(DispatchStatus(running=[RunningAction(plan_id=7, action_id=3)]))
    dispatch = ActionDispatch(plan_id=7, action_id=3, name="navigate")
    naive._spawn(Execution(dispatch, [], "life"))
    assert naive.lived == ["(navigate)"]
