# SPDX-License-Identifier: Apache-2.0
"""From when on a condition on numbers holds that change at given times."""

from typing import Dict, Optional

import pytest

from merlin_pddl.formula import Comparison, Fluent, Number
from merlin_rosplan.dispatch.operator_model import Conditions, Inequality, PlanTerm
from merlin_rosplan.dispatch.plan_graph import TimedValue
from merlin_rosplan.dispatch.timed_numbers import TimedNumbers

CHARGE, LOAD = PlanTerm("charge", ("R1",)), PlanTerm("load", ("R1",))
ENOUGH = Conditions(comparisons=(Inequality(Comparison(">=", Fluent("charge", ("R1",)), Number(3.0))),))
ROOM = Conditions(
    comparisons=(Inequality(Comparison("<", Fluent("load", ("R1",)), Fluent("charge", ("R1",)))),)
)


def since(
    conditions: Conditions,
    now: float,
    *timed: TimedValue,
    before: float = 0.0,
    changed: Optional[Dict[PlanTerm, float]] = None,
) -> Optional[float]:
    """From when on conditions hold; before all timed values the charge is `before`, and the load 2."""
    values = {CHARGE.key: before, LOAD.key: 2.0}
    return TimedNumbers(timed, values, 0.001).since(conditions, now, changed or {})


def charge(time: float, value: float) -> TimedValue:
    return TimedValue(time, CHARGE, value)


def test_a_condition_waits_for_the_value_that_makes_it_true() -> None:
    assert since(ENOUGH, 9.0, charge(2.0, 1.0), charge(4.0, 3.0)) == 4.0


def test_values_after_the_one_that_made_it_true_are_not_waited_for() -> None:
    assert since(ENOUGH, 9.0, charge(2.0, 1.0), charge(4.0, 5.0), charge(6.0, 7.0)) == 4.0
    assert since(ENOUGH, 9.0, charge(6.0, 7.0), charge(4.0, 5.0)) == 4.0  # given in any order


def test_a_condition_that_held_before_all_values_waits_for_none() -> None:
    assert since(ENOUGH, 9.0, charge(2.0, 4.0), charge(4.0, 5.0), before=3.0) is None


def test_a_condition_that_was_false_meanwhile_waits_until_it_holds_again() -> None:
    assert since(ENOUGH, 9.0, charge(2.0, 5.0), charge(4.0, 1.0), charge(6.0, 5.0), before=3.0) == 6.0


@pytest.mark.parametrize(("now", "expected"), [(4.0, 4.0), (3.9995, 4.0), (3.0, 2.0)])
def test_values_that_come_later_than_the_node_do_not_count(now: float, expected: float) -> None:
    assert since(ENOUGH, now, charge(2.0, 4.0), charge(3.5, 0.0), charge(4.0, 5.0)) == expected


def test_values_of_other_terms_do_not_count() -> None:
    assert since(ENOUGH, 9.0, charge(2.0, 4.0), TimedValue(4.0, LOAD, 9.0)) == 2.0
    assert since(ENOUGH, 9.0, TimedValue(4.0, LOAD, 9.0)) is None


def test_a_condition_on_two_terms_waits_for_the_last_that_it_needs() -> None:
    assert since(ROOM, 9.0, charge(1.0, 2.0), TimedValue(3.0, LOAD, 1.0), charge(5.0, 4.0)) == 3.0


def test_after_a_change_of_an_action_only_values_behind_it_are_waited_for() -> None:
    values = charge(2.0, 4.0), charge(4.0, 4.5), charge(6.0, 5.0)
    assert since(ENOUGH, 9.0, *values, changed={CHARGE.key: 3.0}) == 6.0
    assert since(ENOUGH, 9.0, *values, changed={CHARGE.key: 7.0}) is None
    assert since(ENOUGH, 9.0, *values, changed={LOAD.key: 7.0}) == 2.0


def test_several_conditions_wait_for_the_latest() -> None:
    both = ENOUGH + ROOM
    assert since(both, 9.0, charge(1.0, 3.0), TimedValue(3.0, LOAD, 4.0), TimedValue(5.0, LOAD, 1.0)) == 5.0
