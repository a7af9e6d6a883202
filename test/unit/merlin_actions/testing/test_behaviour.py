# SPDX-License-Identifier: Apache-2.0
"""Simulated servers behave as their shares and their seed say."""

from collections import Counter
from typing import Dict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_actions.testing.behaviour import Act, Behaviour


@given(st.integers(0, 10**6), st.integers(0, 10**6))
def test_the_same_goal_of_a_seed_has_always_the_same_fate(seed: int, number: int) -> None:
    shares = {"duration": 1.0, "spread": 0.5, "fail": 0.2, "hang": 0.2, "crash": 0.2}
    draw = Behaviour(seed=seed, **shares).draw(number)
    assert draw == Behaviour(seed=seed, **shares).draw(number)
    assert draw.duration >= 0.0


@pytest.mark.parametrize("act", [Act.FAIL, Act.HANG, Act.CRASH])
def test_a_share_of_one_is_every_goal_and_none_is_no_goal(act: Act) -> None:
    always, never = Behaviour(**{act.value: 1.0}), Behaviour()
    assert {always.draw(number).act for number in range(50)} == {act}
    assert {never.draw(number).act for number in range(50)} == {Act.SUCCEED}


def test_shares_are_met_in_the_long_run() -> None:
    behaviour = Behaviour(fail=0.5, hang=0.25, seed=3)
    count = Counter(behaviour.draw(number).act for number in range(2000))
    assert abs(count[Act.FAIL] - 1000) < 100 and abs(count[Act.HANG] - 500) < 100
    assert count[Act.CRASH] == 0


@pytest.mark.parametrize(
    "wrong",
    [{"fail": 1.1}, {"hang": -0.1}, {"fail": 0.6, "crash": 0.6}, {"duration": -1.0}, {"spread": -1.0}],
)
def test_shares_and_times_that_cannot_be_are_refused(wrong: Dict[str, float]) -> None:
    with pytest.raises(ValueError, match="have to be|cannot be negative"):
        Behaviour(**wrong)
