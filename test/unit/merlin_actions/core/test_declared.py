# SPDX-License-Identifier: Apache-2.0
"""What an action declares for its interruption: literals apart from numbers, variables bound."""

import pytest

from merlin_actions.core.declared import bound, declared_fault, numeric_apart
from merlin_pddl.domain_reader import parse_domain


def test_numbers_are_told_from_facts() -> None:
    facts = ["(robot_at anywhere)", "(not (decreased))", "(increased kitchen)"]
    numbers = ["(decrease (battery) (* 0.1 #t))", " ( Assign (load ?p) 0)", "(increase(battery) 5)"]
    assert numeric_apart([facts[0], *numbers, *facts[1:]]) == (facts, numbers)


def test_variables_are_bound_and_the_duration_stays() -> None:
    text = "(decrease (battery) (* (cost ?From ?to-day) (/ #t ?duration)))"
    assert bound(text, {"from": "hall", "to-day": "attic"}) == (
        "(decrease (battery) (* (cost hall attic) (/ #t ?duration)))"
    )
    with pytest.raises(ValueError, match=r"\?From"):
        bound(text, {"to-day": "attic"})


DOMAIN = parse_domain("""(define (domain d) (:requirements :typing :fluents) (:types place item)
    (:constants anywhere - place) (:predicates (robot_at ?p - place) (quiet))
    (:functions (battery) (way ?from ?to - place))
    (:action go :parameters (?from ?to - place) :effect (robot_at ?to)))""")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("(robot_at anywhere)", ""),
        ("(not (robot_at ?to))", ""),
        ("(increase (battery) (* (way ?from dock) (- 1 (/ #t ?duration))))", ""),
        ("(increase (batery) (* 2 #t))", "unknown function 'batery' (did you mean 'battery'?)"),
        ("(robot_at anywere)", "unknown object 'anywere' (did you mean 'anywhere'?)"),
        ("(robot_at ?too)", "unknown variable '?too' (did you mean '?to'?)"),
        ("(not (robot_at towel))", "'towel' is of type item, but 'robot_at' takes place here"),
        ("(quit)", "unknown predicate 'quit' (did you mean 'quiet'?)"),
        ("(assign (battery))", "'assign' takes a function and a value"),
        ("quiet", "expected"),
    ],
)
def test_what_is_declared_is_compared_with_the_domain(text: str, said: str) -> None:
    fault = declared_fault(text, "Go", DOMAIN, {"dock": ("place",), "towel": ("item",)})
    assert fault.startswith(said) and bool(fault) == bool(said)


def test_an_operator_that_the_domain_does_not_know_is_not_judged() -> None:
    assert declared_fault("(quit)", "fly", DOMAIN, {}) == ""
