# SPDX-License-Identifier: Apache-2.0
"""What goals cost: planned by the robot's own planner from the present state, behind its queue."""

import itertools
from pathlib import Path
from typing import Iterator, Tuple

import pytest

from merlin_fleet.core.records import Goal
from merlin_fleet.node.planned_cost import (
    CannotPlan,
    PlannedCost,
    RobotDomain,
    domain_identity,
    length,
    vocabulary,
)
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain, read_domain
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import read_problem
from merlin_rosplan.planning.planner import PlannerSettings

HOME = Path(__file__).resolve().parents[4] / "pddl" / "home"
NUMBERS = itertools.count(1)


class Files:
    """A knowledge base as its files have it; while the robot drives, it is nowhere."""

    def __init__(self) -> None:
        self.drives = False

    def snapshot(self) -> Tuple[Domain, Problem]:
        domain = read_domain(HOME / "domain.pddl")
        problem = read_problem(HOME / "problem.pddl", domain)
        if self.drives:
            problem.facts = [each for each in problem.facts if each.text() != "(robot_at anywhere)"]
        return domain, problem


@pytest.fixture
def files() -> Files:
    return Files()


@pytest.fixture
def costs(files: Files) -> Iterator[PlannedCost]:
    settings = PlannerSettings(anytime=60.0)  # the search ends before, with the shortest plan
    made = PlannedCost(files, str(HOME / "domain.pddl"), settings, 10.0, 60.0, lambda: files.drives)
    yield made
    made.close()


def goal(*texts: str) -> Goal:
    return Goal(f"g{next(NUMBERS)}", texts, 0.0)


def test_the_length_of_the_plan_behind_the_queue(costs: PlannedCost) -> None:
    kitchen, reason = costs.cost(goal("(checked kitchen)"), ())
    assert kitchen == pytest.approx(28.2 + 5.0, abs=0.1), reason
    bathroom, _ = costs.cost(goal("(checked bathroom)"), (goal("(checked kitchen)"),))
    assert bathroom == pytest.approx(29.9 + 5.0 + 33.2, abs=0.2)
    assert costs.cost(goal("(in_service)"), ()) == (0.0, "")
    # What is queued and cannot be done any more does not keep the robot.
    assert costs.cost(goal("(in_service)"), (goal("(checked moon)"),)) == (0.0, "")


def test_why_there_is_no_plan(costs: PlannedCost) -> None:
    cost, reason = costs.cost(goal("(checked moon)"), ())
    assert cost is None
    assert "moon" in reason
    cost, reason = costs.cost(goal("(not (checked kitchen))", "(checked kitchen)"), ())
    assert cost is None
    assert reason.startswith("no plan (")


def test_a_robot_that_drives_bids_a_stated_time(costs: PlannedCost, files: Files) -> None:
    files.drives = True
    assert costs.cost(goal("(checked kitchen)"), ()) == (60.0, "")
    assert costs.cost(goal("(checked kitchen)"), (goal("(checked bathroom)"),)) == (120.0, "")
    cost, reason = costs.cost(goal("(checked moon)"), ())
    assert cost is None
    assert "moon" in reason


def test_nothing_is_planned_after_the_close(costs: PlannedCost) -> None:
    costs.close()
    cost, reason = costs.cost(goal("(checked kitchen)"), ())
    assert cost is None
    assert reason


def test_the_length_of_a_plan() -> None:
    assert length("", 10.0) == 0.0
    assert length("0.000: (a)  [5.000]\n5.001: (b)  [2.000]\n", 10.0) == pytest.approx(7.001)
    assert length("0.000: (a)  [0.001]\n0.001: (b)  [0.001]\n", 10.0) == 20.0
    with pytest.raises(CannotPlan, match="cannot be read"):
        length("nonsense", 10.0)


def test_the_identity_of_a_domain() -> None:
    same = domain_identity("home", "(define (domain home) ; the home\n (:types a))")
    assert same.startswith("home@")
    assert same == domain_identity("home", "(DEFINE (domain home)\n\n(:types a ))")
    assert same != domain_identity("home", "(define (domain home) (:types b))")


def test_what_goals_can_be_about_is_the_domain_without_its_actions() -> None:
    path = HOME / "domain.pddl"
    known, found = read_domain(path), parse_domain(vocabulary(path.read_text(encoding="utf-8")))
    assert (found.predicates, found.functions, found.constants) == (
        known.predicates,
        known.functions,
        known.constants,
    )
    assert list(found.types) == list(known.types)
    assert found.operators == {}


def test_a_knowledge_base_that_begins_anew_with_another_domain_is_noticed(tmp_path: Path) -> None:
    class Knowledge:
        def __init__(self) -> None:
            self.began = read_domain(HOME / "domain.pddl")

        def domain(self) -> Domain:
            return self.began

    knowledge, file = Knowledge(), tmp_path / "domain.pddl"
    text = (HOME / "domain.pddl").read_text()
    file.write_text(text)
    known = RobotDomain(knowledge, lambda: str(file))
    assert known.identity == domain_identity("home", text) and known.vocabulary == vocabulary(text)
    file.write_text(text.replace("checked", "looked_at"))
    assert not known.replaced(), "it has not read the file again"
    file.write_text(text)
    knowledge.began = read_domain(file)
    assert not known.replaced(), "it has the same one"
    file.write_text(text.replace("checked", "looked_at"))
    knowledge.began = read_domain(file)
    assert known.replaced()
