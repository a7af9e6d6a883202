# SPDX-License-Identifier: Apache-2.0
"""What a dispatcher asks and hears of a knowledge base in its own process."""

from types import SimpleNamespace
from typing import Any, FrozenSet, List, Optional

import pytest
from knowledge_world import add

from merlin_pddl.knowledge import Fact, FunctionValue, Instance
from merlin_rosplan.dispatch.operator_model import Conditions, PlanTerm
from merlin_rosplan.dispatcher import plan_knowledge
from merlin_rosplan.dispatcher.dispatch_topics import KnowledgeEvents
from merlin_rosplan.dispatcher.plan_knowledge import PlanKnowledge


@pytest.fixture(autouse=True)
def in_process(store: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        plan_knowledge.Component, "in_process", staticmethod(lambda _: SimpleNamespace(store=store))
    )


def test_a_dispatch_hears_the_names_of_what_has_changed(store: Any) -> None:
    heard: List[Optional[FrozenSet[str]]] = []
    KnowledgeEvents(SimpleNamespace(knowledge_base="/kb"), lambda event: heard.append(event.names))
    add(store, Fact("CHECKED", ("hall",)), FunctionValue("battery", ("r1",), 1.0))
    add(store, Fact("checked", ("hall",), negative=True))
    add(store, Instance("poi", "cellar"))
    with store.transaction("test") as transaction:
        transaction.clear()
    assert heard == [frozenset({"checked", "battery"}), frozenset({"checked"}), frozenset({""}), None]


def test_conditions_are_looked_up_without_messages(store: Any) -> None:
    add(store, Fact("checked", ("hall",)))
    hall, kitchen = PlanTerm("Checked", ("HALL",)), PlanTerm("checked", ("kitchen",))
    same, other = PlanTerm("=", ("hall", "Hall")), PlanTerm("=", ("hall", "kitchen"))
    asked = [
        Conditions((hall, same, kitchen, other)),
        Conditions(),
        Conditions((), (kitchen, other, hall, same)),
    ]
    knowledge = PlanKnowledge("/kb")
    assert knowledge.false_of_each(asked) == [
        Conditions((kitchen, other)),
        Conditions(),
        Conditions((), (hall, same)),
    ]
