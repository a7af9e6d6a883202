# SPDX-License-Identifier: Apache-2.0
"""What a client refuses to send, whoever asks for it."""

import re
from typing import Any, Dict

import pytest

from merlin_executor.core.request_limits import MAX_TEXT
from merlin_fleet.core.records import LONGEST_RECORD, Goal, Profile, Schema, encode
from merlin_fleet.goal_refusals import check_goal, refused
from merlin_fleet.hub import LARGEST, PAGE


def goal(text: str = "(done a)", **more: Any) -> Goal:
    return Goal("g1", (text,), 0.0, "ann@desk", **more)


@pytest.mark.parametrize(
    "large",
    [
        goal(needs=("x" * LONGEST_RECORD,)),
        goal(groups=tuple(f"g{number}" for number in range(LONGEST_RECORD))),
        goal(domain="x" * LONGEST_RECORD),
        goal(f"(done a) ;{'ä' * (MAX_TEXT - 100)}"),  # six characters each, as the hub keeps them
    ],
)
def test_a_goal_that_would_fill_the_hubs_messages_is_refused(large: Goal) -> None:
    with pytest.raises(ValueError, match=re.escape(f"it may have {LONGEST_RECORD}")):
        check_goal(large)


def test_the_largest_goals_fit_into_what_the_hub_sends_at_once() -> None:
    largest = goal(f"(done {'a' * (MAX_TEXT - 7)})")
    check_goal(largest)
    assert len(encode(largest)) <= LONGEST_RECORD
    assert PAGE * (LONGEST_RECORD + 1000) < LARGEST


@pytest.mark.parametrize("text", [5, None, ["(done a)"]])
def test_what_is_not_a_text_is_not_a_goal(text: Any) -> None:
    with pytest.raises(ValueError, match=re.escape(f"a goal is a text, not {text!r}")):
        check_goal(goal(text))


# --- what the robots know -------------------------------------------------------------------------------

DOMAIN = """(define (domain home) (:types poi cup)
  (:predicates (checked ?p - poi) (at ?c - cup ?p - poi)) (:functions (battery)))"""
HOME = Schema(DOMAIN, ("kitchen poi", "hall poi", "mug cup"))
SHOP = Schema("(define (domain shop) (:predicates (sold ?x)))", ("tea object",))
BOTH = {"ann": Profile("ann", ("ward",)), "bob": Profile("bob")}


@pytest.mark.parametrize(
    ("text", "more", "why"),
    [
        (
            "(flies kitchen)",
            {},
            "ann, bob: (flies kitchen): unknown predicate 'flies'; there is at, checked",
        ),
        (
            "(cheked hall)",
            {},
            "ann, bob: (cheked hall): unknown predicate 'cheked' (did you mean 'checked'?)",
        ),
        (
            "(checked hall kitchen)",
            {},
            "ann, bob: (checked hall kitchen): 'checked' takes 1 argument(s), here are 2",
        ),
        (
            "(checked moon)",
            {},
            "ann, bob: (checked moon): unknown object 'moon'; there is hall, kitchen, mug",
        ),
        ("(checked mug)", {}, "ann, bob: (checked mug): 'mug' is of type cup, but 'checked' takes poi here"),
        ("(> (fuel) 1)", {}, "ann, bob: (> (fuel) 1): unknown function 'fuel'; there is battery"),
        (
            "(or (checked hall) (checked kitchen))",
            {},
            "ann, bob: (or (checked hall) (checked kitchen)) is not a fact, a negated fact, a comparison",
        ),
        ("(checked moon)", {"groups": ("ward",)}, "ann: (checked moon): unknown object 'moon'"),
        ("(checked hall)", {"robot": "eve"}, "there is no robot 'eve' in the fleet; there is ann, bob"),
    ],
)
def test_what_no_robot_knows_is_refused_with_what_there_is(text: str, more: Dict[str, Any], why: str) -> None:
    assert refused(goal(text, **more), BOTH, {"ann": HOME, "bob": HOME}).startswith(why)


@pytest.mark.parametrize(
    "text", ["(Checked HALL)", "(and (checked hall) (not (at mug kitchen)))", "(>= (battery) 20)"]
)
def test_a_goal_that_robots_know_is_taken(text: str) -> None:
    assert refused(goal(text), BOTH, {"ann": HOME, "bob": HOME}) == ""


def test_each_robot_counts_by_its_own_domain() -> None:
    known = {"ann": HOME, "bob": SHOP}
    assert refused(goal("(sold tea)"), BOTH, known) == ""
    ann, bob = refused(goal("(bought tea)"), BOTH, known).split("; bob: ")
    assert ann == "ann: (bought tea): unknown predicate 'bought'; there is at, checked"
    assert bob == "(bought tea): unknown predicate 'bought'; there is sold"
    assert refused(goal("(sold tea)", robot="ann"), BOTH, known).startswith("ann: (sold tea)")


@pytest.mark.parametrize("schemas", [{}, {"ann": HOME}, {"ann": HOME, "bob": Schema("(define")}])
def test_a_robot_whose_domain_is_not_known_may_take_it(schemas: Dict[str, Schema]) -> None:
    assert refused(goal("(flies kitchen)"), BOTH, schemas) == ""


def test_a_fleet_without_robots_takes_goals_for_any_of_them() -> None:
    assert refused(goal("(flies kitchen)"), {}, {}) == ""
    expected = "there is no robot 'ann' in the fleet; there is none"
    assert refused(goal("(flies kitchen)", robot="ann"), {}, {}) == expected
