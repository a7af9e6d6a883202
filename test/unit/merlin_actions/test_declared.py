"""What an action declares for its interruption: literals apart from numbers, variables bound."""

import pytest

from merlin_actions.core.declared import bound, numeric_apart


def test_numbers_are_told_from_facts() -> None:
    facts = ["(robot_at anywhere)", "(not (decreased))", "(increased kitchen)"]
    numbers = ["(decrease (battery) (* 0.1 #t))", " ( Assign (load ?p) 0)"]
    assert numeric_apart([facts[0], *numbers, *facts[1:]]) == (facts, numbers)


def test_variables_are_bound_and_the_duration_stays() -> None:
    text = "(decrease (battery) (* (cost ?from ?to-day) (/ #t ?duration)))"
    assert bound(text, {"from": "hall", "to-day": "attic"}) == (
        "(decrease (battery) (* (cost hall attic) (/ #t ?duration)))"
    )
    with pytest.raises(ValueError, match=r"\?from"):
        bound(text, {"to-day": "attic"})
