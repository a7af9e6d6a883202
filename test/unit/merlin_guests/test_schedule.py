# SPDX-License-Identifier: Apache-2.0
"""The evening's schedule: from the seed alone, with every disturbance that is asked for."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_guests.schedule import (
    DISTURBANCES,
    LEAVES,
    MISSING,
    UNCLEAR,
    WALKS_OFF,
    ScheduleError,
    make_schedule,
    wrong_order,
)
from merlin_restaurant.menu import MENU


@given(st.integers(5, 8), st.integers(0, 10**6))
def test_a_whole_evening_has_every_disturbance_once(guests: int, seed: int) -> None:
    plans = make_schedule(guests, seed, 5)
    assert sorted(kind for plan in plans for kind in plan.disturbances) == sorted(DISTURBANCES)
    assert all(len(plan.disturbances) <= 1 for plan in plans)
    walks = next(plan for plan in plans if WALKS_OFF in plan.disturbances)
    assert not walks.table, "a guest that walks off comes to the entrance first"
    assert len(next(plan for plan in plans if MISSING in plan.disturbances).order) == 2


@given(st.sets(st.sampled_from(list(DISTURBANCES)), max_size=5), st.integers(1, 8), st.integers(0, 10**6))
def test_disturbances_that_are_named_happen_to_who_lives_through_them(
    kinds: set, guests: int, seed: int
) -> None:
    try:
        plans = make_schedule(guests, seed, sorted(kinds))
    except ScheduleError as error:
        assert guests < 3 and "more guests are needed" in str(error)
        return
    assert sorted(kind for plan in plans for kind in plan.disturbances) == sorted(kinds)
    for plan in plans:
        if WALKS_OFF in plan.disturbances:
            assert plan.disturbances == (WALKS_OFF,)
        if LEAVES in plan.disturbances:
            assert set(plan.disturbances) <= {LEAVES, UNCLEAR}


@given(st.integers(2, 8), st.integers(0, 10**6), st.data())
def test_plans_can_be_played(guests: int, seed: int, data: st.DataObject) -> None:
    disturbances = data.draw(st.integers(0, min(guests, 5)))
    plans = make_schedule(guests, seed, disturbances)
    assert plans == make_schedule(guests, seed, disturbances)
    assert sum(len(plan.disturbances) for plan in plans) == disturbances
    tables = [plan.table for plan in plans if plan.table]
    assert len(set(tables)) == len(tables)
    assert all(set(plan.order) <= set(MENU) and 1 <= len(plan.order) <= 2 for plan in plans)
    assert [plan.comes for plan in plans] == sorted(plan.comes for plan in plans)
    assert len(plans) - sum(plan.cleared == 0.0 for plan in plans) >= len(plans) - 2


@pytest.mark.parametrize("guests, disturbances", [(0, 0), (9, 0), (2, 3), (8, 6), (3, -1)])
def test_what_cannot_be_is_said(guests: int, disturbances: int) -> None:
    with pytest.raises(ScheduleError, match="cannot be"):
        make_schedule(guests, 1, disturbances)


def test_a_disturbance_that_does_not_exist_is_said() -> None:
    with pytest.raises(ScheduleError, match="'fire' cannot be; disturbances are unclear, missing"):
        make_schedule(3, 1, ["fire"])


@given(st.sets(st.sampled_from(MENU), min_size=1, max_size=2), st.integers())
def test_a_wrong_order_is_wrong_and_not_empty(items: set, seed: int) -> None:
    wrong = wrong_order(tuple(items), Random(seed))
    assert wrong and sorted(wrong) != sorted(items)
