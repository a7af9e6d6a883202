# SPDX-License-Identifier: Apache-2.0
"""Why a step or a goal: sentences, claims with their evidence, and questions that are wrong."""

import pytest
from explained import PLAN, courier

from merlin_explain.claims import QuestionError, Words
from merlin_explain.core.why import Doing, Request, why
from merlin_pddl.text_reader import PddlError

ASKED = Doing(True, ["(drive hall ward)"], [Request("r-1", ["(in box_1 ward)"], "Ana", 3)])


def ask(about, doing=ASKED, **task):
    return why(about, courier(**task), doing, Words())


def test_a_step_serves_a_later_one_and_its_goal():
    answer = ask("(drive hall ward)")
    assert answer.sentence == (
        "Step 2, “(drive hall ward)”, is there for “(in box_1 ward)”. Without it, “(at ward)” would not "
        "hold, which step 3, “(unload box_1 ward)”, needs. Ana asked for “(in box_1 ward)”, with priority 3."
    )
    kinds = [claim.kind for claim in answer.claims]
    assert kinds == ["step", "link", "serves", "request"]
    assert "runs now" in answer.claims[0].text
    link = answer.claims[1]
    assert [(each.kind, each.text, each.step) for each in link.evidence] == [
        ("step", "(drive hall ward)", 2),
        ("step", "(unload box_1 ward)", 3),
        ("fact", "(at ward)", 0),
    ]
    assert all(claim.evidence for claim in answer.claims)


def test_a_step_that_nothing_needs_is_called_so():
    plan = f"{PLAN}\n16.1: (light ward) [1.000]"
    answer = ask("(light ward)", plan=plan)
    assert "is not needed" in answer.sentence
    assert "needless" in [claim.kind for claim in answer.claims]


def test_spelling_does_not_count():
    assert ask("( Drive HALL  ward )").sentence == ask("(drive hall ward)").sentence


def test_a_goal_has_who_asked_and_what_brings_it_about():
    answer = ask("(in box_1 ward)")
    assert answer.sentence == (
        "Ana asked for “(in box_1 ward)”, with priority 3. Steps 1, 2 and 3 bring “(in box_1 ward)” about."
    )
    held = ask("(door hall ward)", goal="(in box_1 ward) (door hall ward)")
    assert "held already when the plan was made" in held.sentence and "no request" in held.sentence


@pytest.mark.parametrize("requests", [[], [Request("r-2", ["(at yard)"])]], ids=["idle", "another one waits"])
def test_a_goal_of_a_plan_that_is_over_is_no_goal_now(requests):
    over = ask("(in box_1 ward)", doing=Doing(requests=requests))
    assert over.sentence == (
        "The last plan was made for “(in box_1 ward)”, and no request of the Executor asks for it now. "
        "Steps 1, 2 and 3 bring “(in box_1 ward)” about."
    )
    carried_out = ask("(in box_1 ward)", doing=Doing(True, requests=requests))
    assert carried_out.sentence.startswith(
        "“(in box_1 ward)” is a goal of the knowledge base, and no request"
    )


@pytest.mark.parametrize(
    "about, said",
    [
        ("(drive ward hall)", "is not in the plan"),
        ("(drive hall)", r"has 1 objects, and the action is \(drive \?from \?to\)"),
        ("(dirve hall ward)", "neither an action nor a predicate 'dirve'.*'drive'"),
        ("(at roof)", "is not a goal of the plan"),
    ],
)
def test_what_is_neither_step_nor_goal_is_refused(about, said):
    with pytest.raises(QuestionError, match=said):
        ask(about)


@pytest.mark.parametrize("about", ["drive hall ward", "(drive hall ward", "(at moon)", "(and)x", "()"])
def test_what_is_no_pddl_of_the_domain_is_refused(about):
    with pytest.raises((PddlError, QuestionError)):
        ask(about)
