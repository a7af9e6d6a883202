# SPDX-License-Identifier: Apache-2.0
"""A naive action carries out one execution after the other, whatever its dispatcher says meanwhile."""

import threading
from types import SimpleNamespace
from typing import Any, Dict, List

import pytest
from fakes.dispatched import Dispatcher
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions.nodes.naive_action import DECLARED, NaiveAction
from merlin_sm.states.merlin_state import SUCCEEDED
from merlin_test import LONG


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


def test_an_action_that_waits_for_another_one_is_carried_out_behind_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dispatcher = Dispatcher(monkeypatch)
    begun, goes_on = threading.Event(), threading.Event()

    def run_once(binding: Dict[str, str]) -> str:
        begun.set()
        assert goes_on.wait(LONG)
        return SUCCEEDED

    machine: Any = SimpleNamespace(
        operator_name=lambda: "navigate",
        check_signature=lambda keys: None,
        run_once=run_once,
        cancel=lambda: None,
        **dict.fromkeys(DECLARED, ()),
    )
    naive = NaiveAction(machine)
    naive.start()
    dispatcher.wait_announced()
    first = threading.Thread(target=dispatcher.dispatch, args=(1,), daemon=True)
    first.start()
    assert begun.wait(LONG)
    dispatcher.dispatch(2)  # over another connection
    goes_on.set()
    assert [dispatcher.end().action_id for _ in range(2)] == [1, 2]
    first.join(LONG)
    assert not first.is_alive()
    naive.shutdown()
