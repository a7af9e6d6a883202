# SPDX-License-Identifier: Apache-2.0
"""Why not another plan, and what if: both sides checked, and nothing is called impossible without a proof."""

import pytest
from explained import COURIER, INIT, PLAN, courier_problem, solved

from merlin_explain.claims import QuestionError, Words
from merlin_explain.core.judge import Judge
from merlin_explain.core.other_plan import Found, Wish, what_if, why_not
from merlin_pddl.analysis.demand import demand
from merlin_pddl.analysis.leave_out import leave_out
from merlin_pddl.plan_text import parse_plan
from merlin_pddl.problem_writer import write_problem

DETOUR = """0.000: (load box_1 hall) [3.000]
3.001: (drive hall yard) [10.000]
13.002: (drive yard ward) [10.000]
23.003: (unload box_1 ward) [3.000]"""


def judge(goal="(in box_1 ward)", init=INIT):
    return Judge(COURIER, courier_problem(goal, init))


def found(text, goal="(in box_1 ward)"):
    return Found(parse_plan(text), courier_problem(goal), "", 0.2)


def ask(wish, usual=PLAN, other=None, **task):
    other = Found(None, courier_problem(), "no plan was found", 1.5) if other is None else found(other)
    return why_not(wish, judge(**task), found(usual), other, Words())


def planned_so(wish, one=None):
    """The other plan, as the planner interface has it made."""
    one = one or judge()
    domain, problem = (
        leave_out(COURIER, courier_problem(), wish.without) if wish.without else (COURIER, courier_problem())
    )
    domain, done = demand(domain, one.problem.objects, wish.include)
    one.problem.goals += done
    return solved(domain, write_problem(one.problem, one.domain) if wish.include else problem)


def test_a_worse_plan_is_compared_in_steps_and_time():
    answer = ask(Wish(include=["(drive hall yard)"]), other=DETOUR)
    assert answer.sentence == (
        "A plan with “(drive hall yard)” would be worse: 4 steps and 26.0 s instead of 3 steps and 16.0 s."
    )
    assert [claim.evidence[0].kind for claim in answer.claims] == ["plan", "plan"]


def test_the_foil_may_win():
    answer = ask(Wish(without=["(drive * yard)"]), usual=DETOUR, other=PLAN)
    assert "would be better: 3 steps and 16.0 s instead of 4 steps and 26.0 s" in answer.sentence


def test_a_plan_that_is_so_already_says_so():
    assert "already" in ask(Wish(include=["(load box_1 hall)"])).sentence
    assert "already" in ask(Wish(without=["(light *)"])).sentence


@pytest.mark.parametrize(
    "wish",
    [
        Wish(include=["(drive hall yard)"]),
        Wish(include=["(drive hall yard)", "(drive yard ward)"]),
        Wish(without=["(drive hall ward)"]),
        Wish(["(light hall)"], ["(drive * yard)"]),
    ],
)
def test_the_planner_makes_the_plan_that_is_wished(wish):
    other = planned_so(wish)
    one = judge()
    assert other.steps and not wish.fault(other.steps, one) and not one.fault(other.steps)


def test_without_a_proof_nothing_is_impossible():
    answer = ask(Wish(include=["(drive hall yard)"]))
    assert "I found no plan with “(drive hall yard)” within 1.5 s" in answer.sentence
    assert "no proof" in answer.sentence


def test_a_proof_names_what_cannot_be_reached():
    wish = Wish(include=["(drive hall roof)"])
    assert planned_so(wish).steps is None
    answer = ask(wish)
    assert answer.sentence == (
        "There is no plan with “(drive hall roof)”: “(drive hall roof)” can never begin; what comes "
        "nearest lacks (door hall roof) for drive; no action can make it true."
    )
    assert "impossible" in [claim.kind for claim in answer.claims]
    assert "what comes nearest needs “(load box_1 hall)”" in ask(Wish(without=["(load * *)"])).sentence


def test_a_goal_first_is_checked_in_the_plan():
    goals = "(in box_1 ward) (lit hall)"
    plan = f"{PLAN}\n16.1: (drive ward hall) [10.0]\n26.2: (light hall) [1.0]"
    first = "0.0: (light hall) [1.0]\n" + "\n".join(
        f"{step.time + 2:.3f}: {step} [{step.duration:.3f}]" for step in parse_plan(PLAN)
    )
    one = judge(goals)
    wish = Wish(first=["(lit hall)"])
    assert "reached before" in wish.fault(parse_plan(plan), one)
    answer = why_not(wish, one, found(plan, goals), found(first, goals), Words())
    assert "better: 4 steps and 18.0 s instead of 5 steps and 27.2 s" in answer.sentence


@pytest.mark.parametrize("text", ["()", "(and)", "(lit yard)", "(and (lit hall) (lit yard))"])
def test_only_a_goal_can_be_first(text):
    """Of others it is not known when a plan reaches them."""
    goals = "(in box_1 ward) (lit hall)"
    with pytest.raises(QuestionError, match=r"is not one of the goals, which are .*\(lit hall\)"):
        why_not(Wish(first=[text]), judge(goals), found(PLAN, goals), found(PLAN, goals), Words())


def test_a_plan_that_does_not_stand_a_check_is_not_reported():
    with pytest.raises(QuestionError, match="does not stand a check"):
        ask(Wish(include=["(drive hall yard)"]), other="0.0: (drive hall yard) [10.0]")
    with pytest.raises(QuestionError, match="is not in it"):
        ask(Wish(include=["(drive hall yard)"]), usual=PLAN, other=PLAN)


def test_what_a_plan_changes_can_be_the_next_state():
    assert judge().effects(parse_plan(PLAN)) == [
        "(at ward)",
        "(in box_1 ward)",
        "(not (at hall))",
        "(not (in box_1 hall))",
        "(= (battery) 38)",
    ]


def test_what_if_has_both_plans():
    answer = what_if("If “(at ward)” were so", judge(), found(DETOUR), found(PLAN), Words())
    assert (
        answer.sentence
        == "If “(at ward)” were so, the plan would have 3 steps and 16.0 s instead of 4 steps and 26.0 s."
    )
    none = Found(None, "", "none", 0.4)
    assert "I found no plan within 0.4 s" in what_if("If so", judge(), None, none, Words()).sentence
    shut = judge(init="(at hall) (in box_1 hall) (= (battery) 40)")
    assert "there would be no plan" in what_if("If so", shut, None, none, Words()).sentence
