# SPDX-License-Identifier: Apache-2.0
"""The book of a dispatch whose dispatcher says nothing: what stands still, and what is another plan."""

from typing import Set

from merlin_planning.dispatch_progress import Action, DispatchAnswer, Reply, ground
from merlin_planning.over_rosplan import PlainProgress

NAVIGATE = Action(1, 7, "navigate", ("hall", "kitchen"))


def test_a_dispatch_stands_while_nothing_is_under_way() -> None:
    progress = PlainProgress(20.0, None, set())
    assert progress.patience == 20.0
    progress.answered(1, 7, DispatchAnswer.TAKEN, {})  # before the action itself
    assert progress.patience is None
    progress.dispatched(NAVIGATE)
    assert progress.patience is None
    progress.answered(1, 7, DispatchAnswer.SUCCEEDED, {})
    assert progress.patience == 20.0


def test_an_action_that_nothing_takes_stands_where_its_interface_would_say_so() -> None:
    takers: Set[str] = set()
    first = PlainProgress(20.0, None, takers)
    first.dispatched(NAVIGATE)
    assert first.patience is None  # an interface that never says so may have taken it
    first.answered(1, 7, DispatchAnswer.TAKEN, {})
    second = PlainProgress(20.0, None, takers)
    second.dispatched(NAVIGATE)
    assert second.patience == 20.0
    second.stand_still(20.0)
    result = second.result(Reply())
    assert (result.cancelled, result.action) == (False, "")
    assert "for 20 s, and nothing takes (navigate hall kitchen)" in result.reason


def test_another_plan_than_the_one_that_is_meant_is_noticed() -> None:
    progress = PlainProgress(20.0, ground("navigate", ["HALL", "kitchen"]), set())
    assert progress.other_plan and not progress.begun
    progress.dispatched(NAVIGATE)
    assert progress.begun and not progress.other_plan
    progress = PlainProgress(20.0, ground("navigate", ["hall", "cellar"]), set())
    progress.dispatched(NAVIGATE)
    assert progress.other_plan
    unknown = PlainProgress(20.0, None, set())
    unknown.dispatched(NAVIGATE)
    assert not unknown.other_plan
