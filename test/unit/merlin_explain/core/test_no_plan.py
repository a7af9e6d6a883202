# SPDX-License-Identifier: Apache-2.0
"""One smallest set of facts that would make a plan: enough, and none of it can be left out."""

import pytest
from explained import COURIER, courier_problem, solved
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from merlin_explain.claims import Words
from merlin_explain.core.judge import Judge
from merlin_explain.core.no_plan import missing, no_plan
from merlin_explain.core.other_plan import Found
from merlin_pddl.problem_writer import write_problem

NONE = Found(None, "", "the planner found none", 0.7)


def judge(goal="(in box_1 ward)", init="(at hall) (in box_1 hall) (= (battery) 40)"):
    return Judge(COURIER, courier_problem(goal, init))


def judge_with(one, changes):
    return Judge(COURIER, write_problem(one.problem.changed(changes), one.domain))


def ask(one):
    lacking = missing(one)
    then = judge_then = None
    if lacking.changes:
        judge_then = judge_with(one, lacking.changes)
        then = solved(COURIER, write_problem(judge_then.problem, judge_then.domain))
    return no_plan(one, NONE, lacking, then, judge_then, Words())


def test_a_door_would_be_enough():
    answer = ask(judge())
    assert answer.sentence.startswith("There is no plan: “(in box_1 ward)” cannot be reached")
    assert answer.sentence.endswith("With “(door hall ward)” there would be a plan of 3 steps.")
    assert [claim.kind for claim in answer.claims] == ["impossible", "enough"]


def test_several_things_are_missing_and_none_of_them_too_many():
    answer = ask(judge("(in box_1 ward) (in box_2 ward)", "(at hall) (in box_1 hall) (= (battery) 1)"))
    enough = answer.claims[-1]
    facts = {each.text for each in enough.evidence if each.kind != "plan"}
    assert "(= (battery) 5)" in facts and len(facts) >= 3
    assert "smallest" in [claim.kind for claim in answer.claims]


def test_a_number_is_missed_by_so_much():
    answer = ask(judge(init="(at hall) (in box_1 hall) (door hall ward) (= (battery) 4)"))
    assert "at most 4 can be reached" in answer.sentence
    assert "With “(= (battery) 5)” there would be a plan of 3 steps." in answer.sentence


def test_where_nothing_is_proved_nothing_is_claimed():
    one = judge(init="(at hall) (in box_1 hall) (door hall ward) (= (battery) 40)")
    lacking = missing(one)
    assert lacking.gaps == [] and lacking.changes == []
    assert "no proof that there is none" in no_plan(one, NONE, lacking, None, None, Words()).sentence


def test_goals_with_a_plan_have_one():
    one = judge(init="(at hall) (in box_1 hall) (door hall ward) (= (battery) 40)")
    found = solved(
        COURIER, courier_problem(init="(at hall) (in box_1 hall) (door hall ward) (= (battery) 40)")
    )
    assert no_plan(one, found, missing(one), None, None, Words()).sentence == "There is a plan, of 3 steps."


FACTS = st.lists(
    st.sampled_from(
        [
            "(at hall)",
            "(at yard)",
            "(in box_1 hall)",
            "(in box_2 yard)",
            "(held box_2)",
            "(door hall ward)",
            "(door yard hall)",
            "(door hall yard)",
            "(lit ward)",
        ]
    ),
    unique=True,
)


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    FACTS,
    st.sampled_from([0, 4, 5, 40]),
    st.lists(st.sampled_from(["(in box_1 ward)", "(in box_2 ward)", "(lit roof)"]), min_size=1, unique=True),
)
def test_no_set_is_too_small_or_too_large(facts, battery, goals):
    one = judge(" ".join(goals), f"{' '.join(facts)} (= (battery) {battery})")
    lacking = missing(one)
    if lacking.gaps:  # what is called impossible is so
        assert solved(COURIER, write_problem(one.problem, one.domain), 1.0).steps is None
    for left_out in lacking.changes:
        rest = [each for each in lacking.changes if each is not left_out]
        assert solved(COURIER, write_problem(one.problem.changed(rest), one.domain), 1.0).steps is None


@pytest.mark.parametrize("goal", ["(in box_1 ward)", "(lit roof)"])
def test_what_would_be_enough_is_planned(goal):
    assert "there would be a plan" in ask(judge(goal)).sentence
