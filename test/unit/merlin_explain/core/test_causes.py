# SPDX-License-Identifier: Apache-2.0
"""Links between steps: real ones only, and all; an oracle tries each step of plans for the own domains."""

import pytest
from explained import COURIER, PLAN, ROOT, courier, courier_problem, solved

from merlin_explain.claims import QuestionError
from merlin_explain.core.causes import Causes
from merlin_explain.core.judge import Judge
from merlin_pddl.analysis.plan_run import GOAL
from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.plan_text import parse_plan


def shown(links):
    return {(link.taker, link.when, link.text) for link in links}


def test_a_link_names_who_needs_what_and_when():
    causes = courier()
    assert shown(causes.links(0)) == {(2, "start", "(held box_1)")}
    assert shown(causes.links(1)) == {(2, "over all", "(at ward)")}
    assert shown(causes.links(2)) == {(GOAL, "", "(in box_1 ward)")}
    assert [len(causes.goals_served(number)) for number in range(3)] == [1, 1, 1]


def test_what_two_steps_bring_about_is_no_link_of_either():
    plan = f"{PLAN}\n16.1: (light ward) [1.000]\n18.1: (light ward) [1.000]"
    causes = courier("(lit ward)", plan)
    assert causes.links(3) == [] and causes.needless(3) and causes.needless(4)
    assert shown(causes.links(1)) == {
        (2, "over all", "(at ward)"),
        (3, "over all", "(at ward)"),
        (4, "over all", "(at ward)"),
    }
    assert causes.needless(2)


def test_a_goal_that_holds_and_one_with_its_steps():
    causes = courier("(in box_1 ward) (door hall ward)")
    delivered, door = causes.goals
    assert causes.achievers(delivered) == [0, 1, 2] and not causes.holds_before(delivered)
    assert causes.achievers(door) == [] and causes.holds_before(door)


@pytest.mark.parametrize(
    "plan", [PLAN.replace("ward", "yard"), PLAN.split("\n", 1)[1], "0.0: (fly hall) [1.0]"]
)
def test_a_plan_of_another_problem_is_not_explained(plan):
    with pytest.raises(QuestionError, match="do not belong together"):
        courier(plan=plan)


def test_a_number_that_grows_is_followed():
    causes = courier("(at yard)", "0.0: (drive hall yard) [10.0]")
    assert shown(causes.links(0)) == {(GOAL, "", "(at yard)")}
    low = "(at hall) (door hall yard) (door yard ward) (= (battery) 6)"
    with pytest.raises(QuestionError, match=r"\(>= \(battery\) 5\)"):
        courier("(at ward)", "0.0: (drive hall yard) [10.0]\n10.1: (drive yard ward) [10.0]", low)


TASKS = {
    "pddl/home/domain.pddl": (
        "pddl/home/problem.pddl",
        "",
        "(checked kitchen) (checked bathroom) (checked dorm_room)",
    ),
    "pddl/home/robots.pddl": (
        "pddl/home/robots_problem.pddl",
        "(available ann) (available bob)",
        "(checked kitchen) (checked bathroom)",
    ),
    "pddl/robots/domain.pddl": (
        "pddl/robots/problem.pddl",
        "(available ann)",
        "(visited kitchen) (visited main_door)",
    ),
    "pddl/restaurant/domain.pddl": (
        "pddl/restaurant/problem.pddl",
        "",
        "(checked table_1) (checked table_4) (entrance_checked)",
    ),
    "test/data/pddl/robots_domain.pddl": (
        "test/data/pddl/robots_problem.pddl",
        "",
        "(visited kitchen) (visited main_door) (printed one)",
    ),
    "test/data/pddl/workshop.pddl": (
        "test/data/pddl/workshop_problem.pddl",
        "",
        "(stored leg) (stored seat)",
    ),
}


@pytest.mark.parametrize("path", TASKS)
def test_the_oracle_removes_each_step_of_plans_for_the_own_domains(path):
    file, facts, goal = TASKS[path]
    domain, problem = (ROOT / path).read_text(), (ROOT / file).read_text()
    problem = problem[: problem.index("(:goal")] + f"(:goal (and {goal})))"
    found = solved(domain, problem.replace("(:init", f"(:init {facts}"))
    assert found.steps, found.reason
    causes, validator = (
        Causes(Judge(domain, found.problem), found.steps),
        PlanValidator(domain, found.problem),
    )
    for number in range(len(found.steps)):
        rest = [step for each, step in enumerate(found.steps) if each != number]
        assert bool(causes.links(number)) == (validator.fault(rest) is not None), found.steps[number]


def test_the_validator_alone_would_say_it_too():
    validator = PlanValidator(COURIER, courier_problem())
    assert validator.fault(parse_plan(PLAN)) is None
