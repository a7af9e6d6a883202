"""The evening's schedule: from the seed alone, with every disturbance that is asked for."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_restaurant.menu import MENU
from merlin_restaurant.players.schedule import (
    DISTURBANCES,
    WALKS_OFF,
    ScheduleError,
    make_schedule,
    wrong_order,
)


@given(st.integers(5, 8), st.integers(0, 10**6))
def test_a_whole_evening_has_every_disturbance_once(guests: int, seed: int) -> None:
    plans = make_schedule(guests, seed, 5)
    assert sorted(plan.disturbance for plan in plans if plan.disturbance) == sorted(DISTURBANCES)
    walks = next(plan for plan in plans if plan.disturbance == WALKS_OFF)
    assert not walks.table, "who walks off comes to the entrance first"


@given(st.integers(2, 8), st.integers(0, 10**6), st.data())
def test_plans_can_be_played(guests: int, seed: int, data: st.DataObject) -> None:
    disturbances = data.draw(st.integers(0, min(guests, 5)))
    plans = make_schedule(guests, seed, disturbances)
    assert plans == make_schedule(guests, seed, disturbances)
    assert sum(bool(plan.disturbance) for plan in plans) == disturbances
    tables = [plan.table for plan in plans if plan.table]
    assert len(set(tables)) == len(tables) >= 1
    assert all(set(plan.order) <= set(MENU) and 1 <= len(plan.order) <= 2 for plan in plans)
    assert [plan.comes for plan in plans] == sorted(plan.comes for plan in plans)
    assert len(plans) - sum(plan.cleared == 0.0 for plan in plans) >= len(plans) - 2


@pytest.mark.parametrize("guests, disturbances", [(0, 0), (9, 0), (2, 3), (8, 6), (3, -1)])
def test_what_cannot_be_is_said(guests: int, disturbances: int) -> None:
    with pytest.raises(ScheduleError, match="cannot be"):
        make_schedule(guests, 1, disturbances)


@given(st.sets(st.sampled_from(MENU), min_size=1, max_size=2), st.integers())
def test_a_wrong_order_is_wrong_and_not_empty(items: set, seed: int) -> None:
    wrong = wrong_order(tuple(items), Random(seed))
    assert wrong and sorted(wrong) != sorted(items)
