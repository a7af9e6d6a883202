# SPDX-License-Identifier: Apache-2.0
"""The README's numeric `if_interrupted`: a drive that is stopped costs what was really driven."""

import re
from pathlib import Path
from typing import Any, Dict

import pytest
from execution_store import add, apply, facts, value

from merlin_actions.core.declared import bound, numeric_apart
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore

PAGE = (Path(__file__).resolve().parents[4] / "src/merlin_actions/README.md").read_text(encoding="utf-8")
EXAMPLES = dict(re.findall(r"<!-- example: (\w+) -->\n```\w+\n(.*?)```", PAGE, re.DOTALL))
DOMAIN = f"""(define (domain home) (:requirements :durative-actions :typing :numeric-fluents) (:types place)
    (:constants anywhere - place) (:predicates (robot_at ?p - place)) (:functions (battery))
    {EXAMPLES["operator"]})"""
WAY = {"from": "hall", "to": "kitchen"}


@pytest.mark.parametrize(("seconds", "battery"), [(0.0, 50.0), (10.0, 48.75), (40.0, 45.0), (90.0, 45.0)])
def test_the_drive_of_the_readme_costs_what_was_driven(seconds: float, battery: float) -> None:
    made: Dict[str, Any] = {}
    exec(EXAMPLES["class"], made)  # the page's own text
    literals, numeric = numeric_apart(made["Drive"].if_interrupted)
    now = [0.0]
    store = KnowledgeStore(parse_domain(DOMAIN), clock=lambda: int(now[0] * 1e9) + 1)
    add(store, Instance("place", "hall"), Instance("place", "kitchen"), Fact("robot_at", ("hall",)))
    add(store, FunctionValue("battery", (), 50.0))
    interrupted = [*literals, *(bound(text, WAY) for text in numeric)]
    apply(store, "start", "t", "drive", WAY, "/n", [], interrupted)
    assert value(store, "battery") == 45
    now[0] = seconds
    assert apply(store, "interrupt", "t") == ""
    assert value(store, "battery") == pytest.approx(battery)
    assert facts(store) == {"(robot_at anywhere)"}
