# SPDX-License-Identifier: Apache-2.0
"""The domain: what the planner does with what is known and with what is not."""

from pathlib import Path
from typing import List

import pytest
from small_house import HOUSE, state

from deliberation.belief import Belief, fixed_facts, fixed_values, objects
from deliberation.house import State
from merlin_pddl.checks.validate import validate
from merlin_test import LONG

pytestmark = pytest.mark.processes

DOMAIN = Path(__file__).resolve().parents[3] / "examples" / "deliberation" / "pddl" / "domain.pddl"


def plan(
    folder: Path, capsys: pytest.CaptureFixture[str], belief: Belief, true: State, goal: str
) -> List[str]:
    """The actions of the plan for a goal, in their order."""
    named = [f"{' '.join(names)} - {kind}" for kind, names in objects(HOUSE, true.things).items() if names]
    facts = [f"({' '.join(fact)})" for fact in [*fixed_facts(HOUSE), *sorted(belief.facts(true))]]
    values = {**fixed_values(HOUSE), **belief.values(true)}.items()
    numbers = [f"(= ({' '.join(key)}) {value})" for key, value in [*values, (("total-cost",), 0)]]
    problem = folder / "problem.pddl"
    problem.write_text(
        f"(define (problem p) (:domain deliberation) (:objects {' '.join(named)})\n"
        f"(:init {' '.join(facts + numbers)}) (:goal (and)) (:metric minimize (total-cost)))"
    )
    code = validate([str(DOMAIN), str(problem), goal, "--time-limit", str(LONG)])
    output = capsys.readouterr().out
    assert code == 0, output
    return [line for line in output.splitlines() if line.startswith("(")]


def found(spot: str, *things: str) -> Belief:
    belief = Belief(HOUSE, ["mug", "soap"])
    belief.looked(spot, things)
    return belief


def test_a_closed_door_is_opened_before_the_hand_is_full(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert plan(tmp_path, capsys, found("desk", "mug"), state(), "(is_at mug table)") == [
        "(navigate anywhere door hall)",
        "(open_door door hall study)",
        "(navigate door desk study)",
        "(pick mug desk)",
        "(navigate desk table hall)",
        "(place mug table)",
    ]


def test_what_is_not_known_is_looked_for_where_it_may_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    belief = found("table")
    belief.looked("desk", [])
    opened = state(open=state().open | {"door"})
    steps = plan(tmp_path, capsys, belief, opened, "(holding soap)")
    assert steps[1:] == ["(open cabinet)", "(detect soap cabinet)", "(pick soap cabinet)"]


def test_a_low_battery_is_charged_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    opened = state(open=state().open | {"door"}, battery=20.0)
    steps = plan(tmp_path, capsys, found("desk", "mug"), opened, "(holding mug)")
    assert steps[0] == "(charge anywhere dock hall)"


def test_a_full_one_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    opened = state(open=state().open | {"door"}, battery=100.0)
    assert "charge" not in " ".join(plan(tmp_path, capsys, found("desk", "mug"), opened, "(holding mug)"))
