# SPDX-License-Identifier: Apache-2.0
"""The assistant turns PDDL text into one transaction, and what it reads into PDDL text."""

from typing import Any, List, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_planning.knowledge_client import (
    ADD,
    ADD_GOAL,
    REMOVE,
    REMOVE_GOAL,
    KnowledgeError,
    Update,
    fact,
    function_value,
)
from merlin_planning.knowledge_text import PDDLSyntaxError, to_pddl
from merlin_sm import rosplan_assistant
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant


class Knowledge:
    """A knowledge base that notes its transactions."""

    def __init__(self) -> None:
        self.transactions: List[List[Tuple[int, str, bool]]] = []
        self.true = {"(at hall)"}
        self.empty = False

    def update(self, updates: List[Update]) -> None:
        self.transactions.append([(kind, to_pddl(item), bool(item.is_negative)) for kind, item in updates])

    def query(self, items: List[KnowledgeItem]) -> List[bool]:
        return [to_pddl(item) in self.true for item in items]

    def propositions(self, predicate: str) -> List[KnowledgeItem]:
        return [] if self.empty else [fact("at", "hall"), fact("free", "tray")]

    def instances(self, type_name: str) -> List[str]:
        return []

    def _names(self) -> List[str]:
        return ["battery"]

    predicates = types = function_signatures = _names

    def functions(self, name: str) -> List[KnowledgeItem]:
        return [] if self.empty else [function_value(name, ("hall", "Kitchen"), 7.5)]

    def goals(self) -> List[KnowledgeItem]:
        return [fact("checked", "hall")]


@pytest.fixture
def knowledge(monkeypatch: pytest.MonkeyPatch) -> Knowledge:
    made = Knowledge()
    monkeypatch.setattr(rosplan_assistant, "knowledge_client", lambda name: made)
    return made


def test_a_change_is_one_transaction_that_removes_first(knowledge: Knowledge) -> None:
    MerlinROSPlanAssistant().change_facts(add=["(at kitchen)", "(not (quiet))"], remove="(at hall)")
    assert knowledge.transactions == [
        [(REMOVE, "(at hall)", False), (ADD, "(at kitchen)", False), (REMOVE, "(quiet)", False)]
    ]


def test_objects_and_functions_are_written_as_in_pddl(knowledge: Knowledge) -> None:
    robot = MerlinROSPlanAssistant()
    robot.add_objects("box_3 box_4 - box")
    robot.add_objects("box", "box_3", "box_4")
    assert knowledge.transactions[0] == knowledge.transactions[1]
    assert [text for _, text, _ in knowledge.transactions[0]] == ["box_3 - box", "box_4 - box"]
    robot.remove_objects("box_3 - box")
    assert knowledge.transactions[2] == [(REMOVE, "box_3 - box", False)]
    robot.set_value("(distance hall kitchen)", value=3)
    assert knowledge.transactions[3] == [(ADD, "(= (distance hall kitchen) 3)", False)]
    assert robot.value("(distance Hall kitchen)") == robot.value("distance", "hall", "Kitchen") == 7.5
    assert robot.value("(distance hall hall)") is None


@pytest.mark.parametrize(
    "call",
    [
        lambda robot: robot.add_objects("box_3"),
        lambda robot: robot.add_objects("box_3 -"),
        lambda robot: robot.add_objects("- box"),
        lambda robot: robot.add_objects("box_3 - box", "box_4"),
        lambda robot: robot.value("(battery"),
        lambda robot: robot.value("(not (battery))"),
        lambda robot: robot.value("(and)"),
        lambda robot: robot.value("(distance hall)", "kitchen"),
        lambda robot: robot.set_value("battery 3", value=1),
        lambda robot: robot.facts("(checked hall)"),
        lambda robot: robot.objects("box_3 - box"),
    ],
)
def test_what_would_find_or_do_nothing_is_an_error(knowledge: Knowledge, call: Any) -> None:
    with pytest.raises(PDDLSyntaxError):
        call(MerlinROSPlanAssistant())
    assert knowledge.transactions == []


def test_a_name_that_the_domain_does_not_know_is_an_error(knowledge: Knowledge) -> None:
    knowledge.empty = True
    robot = MerlinROSPlanAssistant()
    for call, kind in ((robot.facts, "predicate"), (robot.value, "function"), (robot.objects, "type")):
        with pytest.raises(KnowledgeError, match=f"no {kind} 'batery', only .* .did you mean 'battery'"):
            call("batery")
        assert not call("Battery")


def test_goals_and_facts_are_different_things(knowledge: Knowledge) -> None:
    robot = MerlinROSPlanAssistant()
    robot.add_goals("(and (checked hall) (checked kitchen))")
    robot.remove_goals(["(checked hall)"])
    assert knowledge.transactions == [
        [(ADD_GOAL, "(checked hall)", False), (ADD_GOAL, "(checked kitchen)", False)],
        [(REMOVE_GOAL, "(checked hall)", False)],
    ]
    assert robot.goals() == ["(checked hall)"]


def test_a_condition_holds_when_all_its_parts_do(knowledge: Knowledge) -> None:
    robot = MerlinROSPlanAssistant()
    assert robot.holds("(at hall)")
    assert not robot.holds("(and (at hall) (at kitchen))")
    assert robot.facts() == ["(at hall)", "(free tray)"]


def test_a_value_is_found_whatever_the_case_of_its_arguments(knowledge: Knowledge) -> None:
    robot = MerlinROSPlanAssistant()
    assert robot.value("distance", "HALL", "kitchen") == 7.5
    assert robot.value("distance", "kitchen", "hall") is None


@pytest.mark.parametrize("text", ["(at hall", "at hall)", "(at (hall))", "(or (at hall))", "(9at)"])
def test_text_that_is_not_pddl_changes_nothing(knowledge: Knowledge, text: str) -> None:
    with pytest.raises(PDDLSyntaxError):
        MerlinROSPlanAssistant().change_facts(add=["(at kitchen)", text])
    assert knowledge.transactions == []


names = st.from_regex(r"[a-z][a-z0-9_-]{0,5}", fullmatch=True).filter(
    lambda name: name not in ("and", "not", "or", "forall", "exists", "imply", "when")
)


@given(st.lists(st.tuples(names, st.lists(names, max_size=3), st.booleans()), min_size=1, max_size=4))
def test_facts_written_and_read_again_are_the_same(facts: List[Tuple[str, List[str], bool]]) -> None:
    made = Knowledge()
    robot = MerlinROSPlanAssistant()
    texts = [f"({' '.join([name, *arguments])})" for name, arguments, _ in facts]
    signed = [f"(not {text})" if negative else text for text, (_, _, negative) in zip(texts, facts)]
    original = rosplan_assistant.knowledge_client
    rosplan_assistant.knowledge_client = lambda name: made  # type: ignore[assignment]
    try:
        robot.add_facts(signed)
    finally:
        rosplan_assistant.knowledge_client = original
    expected = [(REMOVE if negative else ADD, text, False) for text, (_, _, negative) in zip(texts, facts)]
    assert made.transactions == [expected]
