# SPDX-License-Identifier: Apache-2.0
"""What is set by hand: only what is new, with what it contradicts, and how it is set back."""

from typing import Any, List, Sequence

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainAssignment, DomainFormula, DomainOperator, KnowledgeItem

from merlin_monitor.web.robot_planning import HandChanges
from merlin_planning.knowledge_client import function_value, parse_changes
from merlin_planning.knowledge_text import to_pddl

DRIVE = {"name": "navigate", "parameters": [["from", "hall"], ["to", "kitchen"]]}


def formula(name: str, *labels: str) -> DomainFormula:
    return DomainFormula(name=name, typed_parameters=[KeyValue(label, "place") for label in labels])


class Knowledge:
    """The robot left the hall for the kitchen; its battery has 20."""

    def query(self, items: Sequence[KnowledgeItem]) -> List[bool]:
        return [to_pddl(item) in ("(checked hall)",) for item in items]

    def functions(self, name: str) -> List[KnowledgeItem]:
        return [function_value("battery", [], 20.0)] if name == "battery" else []

    def operator(self, name: str) -> DomainOperator:
        assert name == "navigate"
        return DomainOperator(
            at_start_del_effects=[formula("robot_at", "from")],
            at_end_add_effects=[formula("robot_at", "to")],
            at_start_simple_condition=[formula("in_service")],
            over_all_simple_condition=[formula("free", "to")],
            at_end_assign_effects=[DomainAssignment(LHS=formula("battery"))],
        )


def changes(text: str) -> Any:
    return HandChanges(Knowledge(), parse_changes(text))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "new", "back"),
    [
        ("(checked kitchen)", 1, "(not (checked kitchen))"),
        ("(not (checked hall))", 1, "(checked hall)"),
        ("(= (battery) 80)", 1, "(= (battery) 20.0)"),
        (
            "(and (checked kitchen) (= (battery) 5) (checked hall))",
            2,
            "(and (not (checked kitchen)) (= (battery) 20.0))",
        ),
        ("(checked hall)", 0, ""),
        ("(= (battery) 20)", 0, ""),
        ("(= (load) 1)", 1, ""),  # had no number before
    ],
)
def test_what_is_new_can_be_set_back(text: str, new: int, back: str) -> None:
    made = changes(text)
    assert (len(made.new), made.back) == (new, back)
    if back:
        parse_changes(back)


@pytest.mark.parametrize(
    ("text", "against"),
    [
        ("(robot_at kitchen)", True),  # what it brings about
        ("(robot_at hall)", True),  # what it has changed
        ("(not (free kitchen))", False),  # is so already
        ("(free Kitchen)", True),  # what it needs
        ("(= (battery) 3)", True),
        ("(robot_at dorm_room)", False),
        ("(in_service)", False),  # was needed when it began
        ("(checked kitchen)", False),
    ],
)
def test_what_an_action_that_runs_needs_or_changes_is_named(text: str, against: bool) -> None:
    found = changes(text).contradicted([DRIVE])
    assert found == ("(navigate hall kitchen)" if against else "")
    assert changes(text).contradicted([]) == ""
