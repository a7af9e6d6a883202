# SPDX-License-Identifier: Apache-2.0
"""Changes of knowledge as PDDL text."""

import pytest

from merlin_planning.knowledge_client import ADD, REMOVE, parse_changes
from merlin_planning.knowledge_text import PDDLSyntaxError, to_pddl


def test_facts_and_values_become_updates_in_their_order() -> None:
    updates = parse_changes("(and (checked kitchen) (not (checked hall)) (= (battery) 20) (= (far a b) 1.5))")
    assert [(update.kind, to_pddl(update.item)) for update in updates] == [
        (ADD, "(checked kitchen)"),
        (REMOVE, "(checked hall)"),
        (ADD, "(= (battery) 20)"),
        (ADD, "(= (far a b) 1.5)"),
    ]


@pytest.mark.parametrize(
    "text", ["(>= (battery) 20)", "(= 20 (battery))", "(= (battery) (+ 1 2))", "(or (a) (b))", "checked", ""]
)
def test_what_is_no_change_is_refused(text: str) -> None:
    with pytest.raises(PDDLSyntaxError):
        parse_changes(text)


@pytest.mark.parametrize(
    "text",
    ["(and (open hall) (not (open Hall)))", "(and (not (open)) (open))", "(and (= (a b) 1) (= (a b) 2))"],
)
def test_what_cannot_all_be_true_is_refused(text: str) -> None:
    with pytest.raises(PDDLSyntaxError, match="given twice, and both cannot be true"):
        parse_changes(text)


def test_what_is_given_twice_alike_is_taken() -> None:
    assert len(parse_changes("(and (open hall) (OPEN hall) (= (a b) 1) (= (a b) 1))")) == 4
