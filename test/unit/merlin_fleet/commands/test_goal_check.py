# SPDX-License-Identifier: Apache-2.0
"""What a client refuses to send, whoever asks for it."""

import re
from typing import Any

import pytest

from merlin_executor.core.request_limits import MAX_TEXT
from merlin_fleet.core.records import Goal, encode
from merlin_fleet.goal_refusals import LONGEST_RECORD, check_goal
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
