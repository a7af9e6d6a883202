# SPDX-License-Identifier: Apache-2.0
"""A program that ends while the planner plans does not say that there is no plan."""

from types import SimpleNamespace
from typing import Any

import pytest
import rospy

from merlin_planning import planning_client
from merlin_planning.planning_client import Planned, PlanningClient


def test_a_program_that_ends_calls_its_planning_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning_client, "TopicWatch", lambda *_: SimpleNamespace(count=0))
    monkeypatch.setattr(planning_client, "ServiceProxy", lambda *_, **__: None)
    monkeypatch.setattr(planning_client, "get_param", lambda *_: {})
    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)

    def send(goal: Any, on_done: Any) -> None:
        monkeypatch.setattr(rospy, "is_shutdown", lambda: True)

    monkeypatch.setattr(planning_client, "ActionClient", lambda *_: SimpleNamespace(alive=True, send=send))
    result = PlanningClient().plan(lambda interrupt: None)
    assert (result.verdict, result.reason) == (Planned.CANCELLED, "this node ends before the planner has")
