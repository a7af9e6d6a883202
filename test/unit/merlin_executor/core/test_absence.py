# SPDX-License-Identifier: Apache-2.0
"""A part that is lost again and again has one deadline."""

from hypothesis import given
from hypothesis import strategies as st

from merlin_executor.core.awaited import Absence

LIMIT = 8.0


def test_a_return_does_not_begin_the_wait_anew() -> None:
    absence = Absence()
    assert absence.lost(100.0, LIMIT) == LIMIT
    absence.back(102.0)
    assert absence.lost(103.0, LIMIT) == 5.0
    absence.back(105.0)
    assert absence.lost(106.0, LIMIT) == 2.0
    absence.back(107.0)
    assert absence.lost(109.0, LIMIT) is None
    assert absence.losses == 4


def test_a_part_that_stayed_as_long_as_it_would_be_waited_for_is_waited_for_again() -> None:
    absence = Absence()
    absence.lost(100.0, LIMIT)
    absence.back(107.0)
    assert absence.lost(115.0, LIMIT) == LIMIT
    assert absence.losses == 1


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 10.0)), max_size=20))
def test_no_absence_is_longer_than_the_limit(scenario: list) -> None:
    """Whatever the part does: it is not waited for beyond the limit unless it has worked for as long."""
    absence, now, first = Absence(), 0.0, 0.0
    for works, away in scenario:
        now += works
        if works >= LIMIT or absence.losses == 0:
            first = now
        left = absence.lost(now, LIMIT)
        if left is None:
            assert now >= first + LIMIT
            return
        assert now + left <= first + LIMIT + 1e-6
        now += min(away, left)
        absence.back(now)
