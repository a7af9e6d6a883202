# SPDX-License-Identifier: Apache-2.0
"""A naive action carries out one execution after the other, whatever its dispatcher says meanwhile."""

from types import SimpleNamespace
from typing import Any, Dict, List

import pytest
from fakes.dispatched import Dispatcher
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions.nodes.naive_action import DECLARED, NaiveAction
from merlin_sm.states.merlin_state import SUCCEEDED


def test_an_action_is_carried_out_after_a_status_of_the_dispatcher(monkeypatch: pytest.MonkeyPatch) -> None:
    dispatcher = Dispatcher(monkeypatch)
    ran: List[Dict[str, str]] = []
    machine: Any = SimpleNamespace(
        operator_name=lambda: "navigate",
        check_signature=lambda keys: None,
        run_once=lambda binding: ran.append(binding) or SUCCEEDED,
        cancel=lambda: None,
        **dict.fromkeys(DECLARED, ()),
    )
    naive = NaiveAction(machine)
    naive.start()
    dispatcher.waits_for(3)
    dispatcher.dispatch(3)
    assert dispatcher.end().status == ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
    assert ran == [{"to": "hall"}]
    naive.shutdown()
