# SPDX-License-Identifier: Apache-2.0
"""What a campaign of the fleet makes of its trials; it runs in namespaces, which needs root and minutes."""

import random
import re
from pathlib import Path

import pytest
from fleet.campaign import HEADS, USUAL, table, violations
from fleet.faults import FAULTS
from fleet.system import Seen, drawn_goals, first_owner_after
from fleet.trial import Row

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "fleet-measurements.md").read_text(encoding="utf-8")


def row(**changes) -> Row:
    made = Row(1, "cut", "ann", 0.5, False, 0, 0, 0, 0, 0, 12.0, 3.0, "")
    return made._replace(**changes)


@pytest.mark.parametrize("what", ["lost", "twice", "forgotten"])
def test_what_must_not_be_is_a_violation(what: str) -> None:
    assert violations(row()) == 0
    assert violations(row(**{what: 2})) == 2


def test_a_fleet_that_does_not_come_back_is_one_and_a_goal_done_again_is_none() -> None:
    assert violations(row(back=None)) == 1
    assert violations(row(again=1, failed=1, next_owner=None)) == 0


def test_the_table_has_a_line_for_each_fault_that_was_tried() -> None:
    rows = [row(), row(next_owner=14.0, lost=1), row(fault="lossy", next_owner=None, back=None)]
    _, _, cut, lossy = table(rows).splitlines()
    assert cut == f"| {FAULTS['cut'].words} | 2 | 4 | 1 | 0 | 0 | 0 | 0 | 13.0 / 14.0 (2) | 3.0 / 3.0 (2) |"
    assert lossy.endswith("|  |  |")


def test_the_next_owner_is_another_robot_after_the_fault() -> None:
    seen = [
        Seen(1.0, "g", "bob", ""),
        Seen(3.0, "g", "", ""),
        Seen(4.0, "h", "bob", ""),
        Seen(5.0, "g", "bob", ""),
    ]
    assert first_owner_after(seen, "g", 2.0, "ann") == 5.0
    assert first_owner_after(seen, "g", 2.0, "bob") is None


def test_the_goals_of_a_trial_differ() -> None:
    for seed in range(20):
        goals = drawn_goals(random.Random(seed), 2)
        assert len(set(goals)) == 2


def test_the_page_has_the_rows_that_a_campaign_prints() -> None:
    _, found = PAGE.split(f"| {' | '.join(HEADS)} |\n", 1)  # the first one; the other is narrowed
    rows = re.match(r"(\|.*\n)+", found)
    assert rows is not None
    assert [line.split(" | ")[0][2:] for line in rows[0].splitlines()[1:]] == [
        FAULTS[name].words for name in USUAL
    ]
