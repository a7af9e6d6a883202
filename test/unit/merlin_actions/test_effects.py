# SPDX-License-Identifier: Apache-2.0
"""Effects over ROSPlan's `update_array`: all of them or none, and what an interrupted action leaves."""

from typing import List, Set

import pytest
from diagnostic_msgs.msg import KeyValue
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.srv import ApplyEffectsRequest
from rosplan_knowledge_msgs.msg import DomainAssignment, DomainFormula, DomainOperator, KnowledgeItem

from merlin_actions import effects
from merlin_actions.core.ending import Closing
from merlin_actions.effects import Opening, ServiceEffects, UpdateEffects
from merlin_planning.knowledge_client import ADD, KnowledgeError, Update, fact
from merlin_planning.knowledge_text import to_pddl


class Knowledge:
    """Facts, changed in transactions."""

    name = "/knowledge"

    def __init__(self, *facts: str) -> None:
        self.facts: Set[str] = set(facts)
        self.transactions = 0

    def query(self, items: List[KnowledgeItem]) -> List[bool]:
        return [to_pddl(item) in self.facts for item in items]

    def update(self, updates: List[Update]) -> None:
        self.transactions += 1
        for kind, item in updates:
            (self.facts.add if kind == ADD else self.facts.discard)(to_pddl(item))


def formula(name: str, *keys: str) -> DomainFormula:
    return DomainFormula(name=name, typed_parameters=[KeyValue(key, "place") for key in keys])


def drive(durative: bool) -> DomainOperator:
    """The operator (drive ?a ?b)."""
    leaves, arrives = [formula("at", "a")], [formula("at", "b")]
    operator = DomainOperator(formula=formula("drive", "a", "b"))
    operator.at_start_del_effects = leaves
    if durative:
        operator.at_end_add_effects = arrives
    else:
        operator.at_start_add_effects = arrives
    return operator


def opening(token: str = "1", interrupted: str = "", running: str = "") -> Opening:
    places = [KeyValue("a", "hall"), KeyValue("b", "kitchen")]
    return Opening(
        places,
        token,
        "/bridges",
        [fact(running)] if running else [],
        [fact("at", interrupted)] if interrupted else [],
    )


def test_what_closes_an_execution_is_named_by_the_number_of_the_message() -> None:
    assert all(getattr(ApplyEffectsRequest, closing.name) == closing for closing in Closing)


def test_a_plain_operator_changes_nothing_before_it_succeeded() -> None:
    knowledge = Knowledge("(at hall)")
    driving = UpdateEffects(drive(durative=False), knowledge)
    driving.open(opening())
    assert knowledge.facts == {"(at hall)"}
    driving.close(opening(), Closing.END, lambda: None)
    assert knowledge.facts == {"(at kitchen)"}


def test_a_durative_operator_leaves_at_its_start_and_arrives_at_its_end() -> None:
    knowledge = Knowledge("(at hall)")
    driving = UpdateEffects(drive(durative=True), knowledge)
    driving.open(opening(running="busy"))
    assert knowledge.facts == {"(busy)"}
    driving.close(opening(running="busy"), Closing.END, lambda: None)
    assert knowledge.facts == {"(at kitchen)"}
    assert knowledge.transactions == 2, "each of them is one transaction"


@pytest.mark.parametrize(
    ("closing", "interrupted", "left"),
    [
        (Closing.INTERRUPT, "anywhere", {"(at anywhere)"}),
        (Closing.INTERRUPT, "", {"(at hall)"}),
        (Closing.ROLLBACK, "anywhere", {"(at hall)"}),
    ],
)
def test_an_interrupted_drive_leaves_what_it_declares_and_an_unbegun_one_nothing(
    closing: Closing, interrupted: str, left: Set[str]
) -> None:
    knowledge = Knowledge("(at hall)")
    driving = UpdateEffects(drive(durative=True), knowledge)
    driving.open(opening(interrupted=interrupted, running="busy"))
    driving.close(opening(interrupted=interrupted, running="busy"), closing, lambda: None)
    assert knowledge.facts == left


FACTS = ("(at hall)", "(at kitchen)", "(busy)", "(door open)")


@given(st.sets(st.sampled_from(FACTS)), st.booleans())
def test_a_rollback_restores_exactly_what_was_there(before: Set[str], durative: bool) -> None:
    knowledge = Knowledge(*before)
    driving = UpdateEffects(drive(durative), knowledge)
    driving.open(opening(running="busy"))
    driving.close(opening(running="busy"), Closing.ROLLBACK, lambda: None)
    assert knowledge.facts == before


@given(st.permutations(["1", "2", "3"]))
def test_executions_at_the_same_time_are_undone_each_by_itself(order: List[str]) -> None:
    knowledge = Knowledge("(at hall)")
    driving = UpdateEffects(drive(durative=True), knowledge)
    for token in ("1", "2", "3"):
        driving.open(opening(token))
    for token in order:
        driving.close(opening(token), Closing.ROLLBACK, lambda: None)
    assert knowledge.facts == {"(at hall)"}


def test_effects_that_its_messages_cannot_carry_are_refused_at_the_start() -> None:
    operator = drive(durative=True)
    operator.at_end_assign_effects = [DomainAssignment()]
    with pytest.raises(ValueError, match="operator drive has numeric or probabilistic effects"):
        UpdateEffects(operator, Knowledge())


def test_original_rosplan_says_that_it_cannot_count_an_interruption() -> None:
    knowledge = Knowledge("(at hall)")
    driving = UpdateEffects(drive(durative=True), knowledge)
    with pytest.raises(KnowledgeError, match="decrease .battery. 1. of if_interrupted"):
        driving.open(opening()._replace(counts=["(decrease (battery) 1)"]))
    assert knowledge.facts == {"(at hall)"}


@pytest.mark.parametrize(("offered", "kind"), [(True, ServiceEffects), (False, UpdateEffects)])
def test_a_knowledge_base_that_is_busy_is_not_taken_for_the_original(
    offered: bool, kind: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Proxy:
        def __init__(self, *_: object, **__: object) -> None: ...

        def offered(self) -> bool:
            return offered

        def available(self) -> bool:  # it takes no connection within a second
            return False

    monkeypatch.setattr(effects, "ServiceProxy", Proxy)
    assert isinstance(effects.effects_of(drive(durative=True), Knowledge()), kind)
