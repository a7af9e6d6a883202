# SPDX-License-Identifier: Apache-2.0
"""The book of a dispatch whose dispatcher says nothing: what stands still, and what is another plan."""

from typing import Dict

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_planning.dispatch_progress import Action, DispatchAnswer, Reply
from merlin_planning.over_rosplan import PlainProgress

NAVIGATE = Action(1, 7, "navigate", ("hall", "kitchen"))


def navigate(*places: str, start: float = 0.0) -> ActionDispatch:
    """A step of a plan that takes 30 s."""
    parameters = [KeyValue("", place) for place in places]
    return ActionDispatch(
        action_id=1, name="navigate", parameters=parameters, dispatch_time=start, duration=30.0
    )


def test_a_dispatch_stands_while_nothing_is_under_way() -> None:
    progress = PlainProgress(20.0, (), {})
    assert progress.patience == 20.0
    progress.answered(1, 7, DispatchAnswer.TAKEN, {})  # before the action itself
    assert progress.patience is None
    progress.dispatched(NAVIGATE)
    assert progress.patience is None
    progress.answered(1, 7, DispatchAnswer.SUCCEEDED, {})
    assert progress.patience == 20.0


def test_an_action_that_nothing_takes_stands_where_its_interface_would_say_so() -> None:
    takers: Dict[str, bool] = {}
    first = PlainProgress(20.0, (), takers)
    first.dispatched(NAVIGATE)
    assert first.patience is None  # an interface that never says so may have taken it
    first.answered(1, 7, DispatchAnswer.TAKEN, {})
    second = PlainProgress(20.0, (), takers)
    second.dispatched(NAVIGATE)
    assert second.patience == 20.0
    second.stand_still(20.0)
    result = second.result(Reply())
    assert (result.cancelled, result.action) == (False, "")
    assert "for 20 s, and nothing takes (navigate hall kitchen)" in result.reason


def test_another_plan_than_the_one_that_is_meant_is_noticed() -> None:
    progress = PlainProgress(20.0, [navigate("HALL", "kitchen")], {})
    assert progress.other_plan and not progress.begun
    progress.dispatched(NAVIGATE)
    assert progress.begun and not progress.other_plan
    progress = PlainProgress(20.0, [navigate("hall", "cellar")], {})
    progress.dispatched(NAVIGATE)
    assert progress.other_plan
    unknown = PlainProgress(20.0, (), {})
    unknown.dispatched(NAVIGATE)
    assert not unknown.other_plan


@pytest.mark.parametrize(
    ("seen", "other"), [("hall", False), ("bath", False), ("cellar", True), ("attic", True)]
)
def test_where_several_actions_begin_a_plan_the_message_of_the_first_may_be_lost(
    seen: str, other: bool
) -> None:
    plan = [navigate("hall"), navigate("bath", start=0.001), navigate("cellar", start=30.001)]
    progress = PlainProgress(20.0, plan, {})
    progress.dispatched(Action(1, 7, "navigate", (seen,)))
    assert progress.other_plan is other


@pytest.mark.parametrize("late", [False, True])
def test_the_failure_of_an_action_whose_message_is_lost_ends_the_dispatch(
    late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(1))
    progress = PlainProgress(20.0, [navigate("hall", "kitchen")], {})
    assert not progress.answered(1, 0, DispatchAnswer.TAKEN, {})
    assert progress.answered(1, 0, DispatchAnswer.FAILED, {"reason": "the way is blocked"})
    if late:
        progress.dispatched(NAVIGATE)
    assert (progress.failed, progress.failed_reason) == ("(navigate hall kitchen)", "the way is blocked")
    assert not progress.running and not progress.other_plan


def test_what_fails_without_a_begin_belongs_to_an_earlier_plan() -> None:
    progress = PlainProgress(20.0, [navigate("hall", "kitchen")], {})
    assert not progress.answered(1, 0, DispatchAnswer.FAILED, {})
    assert not progress.failed


@pytest.mark.parametrize("several", [False, True])
def test_an_action_waits_for_another_one_of_its_operator_unless_both_were_seen_to_run(several: bool) -> None:
    takers: Dict[str, bool] = {"navigate": several}
    progress = PlainProgress(20.0, (), takers)
    for action in (NAVIGATE, NAVIGATE._replace(id=2)):
        progress.dispatched(action)
    assert progress.untaken(2) == NAVIGATE.text
    progress.answered(1, 7, DispatchAnswer.TAKEN, {})
    assert progress.untaken(1) == "" and bool(progress.untaken(2)) is several
    progress.answered(2, 7, DispatchAnswer.TAKEN, {})
    assert takers["navigate"], "it has taken both"
