# SPDX-License-Identifier: Apache-2.0
"""The oracle: expected actions of a robot that knows everything."""

import pytest
from small_house import HOUSE, state

from deliberation.house import words
from deliberation.oracle import expected_actions

DRIVE, HAND, LID = 1 / 0.9, 1 / 0.5, 1 / 0.75
OPENED = state(open=state().open | {"door"})


@pytest.mark.parametrize(
    ("begin", "goals", "expected"),
    [
        (OPENED, "(is_at mug desk)", 0.0),
        (OPENED, "(is_at mug table)", 2 * DRIVE + 2 * HAND),
        (state(), "(is_at mug table)", 3 * DRIVE + LID + 2 * HAND),
        (OPENED, "(is_at soap table)", 2 * DRIVE + LID + 2 * HAND),
        # One drive less: the soap is put on the desk on the way.
        (OPENED, "(is_at soap desk) (is_at mug table)", 3 * DRIVE + LID + 4 * HAND),
        # A full hand closes nothing: back again.
        (OPENED, "(is_at soap table) (not (is_open cabinet))", 3 * DRIVE + 2 * LID + 2 * HAND),
    ],
)
def test_each_action_counts_its_expected_tries(begin: object, goals: str, expected: float) -> None:
    assert expected_actions(HOUSE, begin, words(goals)) == pytest.approx(expected)  # type: ignore[arg-type]


def test_goals_that_cannot_be_reached_have_no_figure() -> None:
    walled = HOUSE._replace(sites={name: site for name, site in HOUSE.sites.items() if name != "door"})
    assert expected_actions(walled, state(), words("(is_at mug table)")) is None
