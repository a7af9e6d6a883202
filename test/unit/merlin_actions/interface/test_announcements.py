# SPDX-License-Identifier: Apache-2.0
"""An action interface announces itself to each new subscriber at once."""

from types import SimpleNamespace
from typing import Any

import pytest
from fakes.topics import Topics
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_interface
from merlin_actions.action_interface import ActionInterface
from merlin_test import LONG

TOPIC = "/kb/pddl_action_parameters"


def test_a_new_subscriber_does_not_wait_for_the_next_period(
    monkeypatch: pytest.MonkeyPatch, clock: Any
) -> None:
    operator = SimpleNamespace(formula=DomainFormula(name="navigate"))
    knowledge = SimpleNamespace(name="/kb", operator=lambda name: operator)
    for name, made in (
        ("ANNOUNCE_PERIOD", 600.0),
        ("LATCH_GRACE", 0.0),
        ("knowledge_client", lambda name: knowledge),
        ("effects_of", lambda details, knowledge: None),
        ("settle_left", lambda knowledge, operator: []),
        ("connected_peers", lambda subscriber: {"/dispatcher"}),
    ):
        monkeypatch.setattr(action_interface, name, made)
    topics = Topics(monkeypatch)
    interface = ActionInterface("navigate")
    interface.start()
    assert topics.published(TOPIC).get(timeout=LONG).name == "navigate"  # the period begins
    topics.subscribe(TOPIC)
    assert topics.published(TOPIC).get(timeout=LONG).name == "navigate"
    interface.shutdown()
