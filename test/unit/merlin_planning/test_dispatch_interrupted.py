# SPDX-License-Identifier: Apache-2.0
"""A dispatch while another client's plan is carried out: that plan is left alone, and the wait has an end."""

from typing import Any, Callable, Optional

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import DispatchStatus

from merlin_planning import dispatch_client
from merlin_planning.dispatch_client import INTERRUPTED, DispatchClient
from merlin_ros.actions.client_goal import ClientGoal
from merlin_test import LONG


def never(interrupt: Optional[Callable[[], None]]) -> None:
    """A caller who does not interrupt."""


def test_nothing_is_dispatched_and_nothing_cancelled(dispatcher: Any) -> None:
    client = dispatcher.client()
    dispatcher.status(DispatchStatus.RUNNING)
    dispatcher.owner("/other")

    def interruptible(interrupt: Optional[Callable[[], None]]) -> None:
        if interrupt is not None:  # the preempt comes as soon as the wait begins
            interrupt()

    result = client.dispatch(interruptible)
    assert dispatcher.calls == []
    assert result.cancelled and not result.gone and result.reason == INTERRUPTED


@pytest.fixture
def unlimited(dispatcher: Any, monkeypatch: pytest.MonkeyPatch) -> DispatchClient:
    """A client whose cancels have no limit."""
    monkeypatch.setattr(dispatch_client, "OWNER_LOOK", 0.001)
    client: DispatchClient = dispatcher.client(cancel_deadline=0.0)
    dispatcher.status(DispatchStatus.RUNNING)
    dispatcher.passed += 2 * dispatch_client.LISTEN  # any owner has been heard by now
    return client


@pytest.fixture
def impatient(unlimited: DispatchClient, monkeypatch: pytest.MonkeyPatch) -> DispatchClient:
    """One that waits for a living owner, and for a cancel to be taken, for a moment only."""
    monkeypatch.setattr(dispatch_client, "FOREIGN_WAIT", 0.05)
    return unlimited


def test_the_plan_of_an_owner_that_lives_is_waited_for_with_an_end(
    dispatcher: Any, impatient: DispatchClient
) -> None:
    dispatcher.owner("/other")
    reason = impatient.free(never)
    assert reason == "the planning system's plan dispatcher /dispatcher carries out a plan of /other"
    assert dispatcher.calls == []


def test_a_plan_without_owner_gets_all_the_time_to_stop(dispatcher: Any, unlimited: DispatchClient) -> None:
    late = dispatcher.passed + 2 * dispatch_client.FOREIGN_WAIT

    def stops_late() -> None:
        if dispatcher.passed >= late:
            dispatcher.status(DispatchStatus.IDLE)
        dispatcher.passed = late

    dispatcher.on_look = stops_late
    assert unlimited.free(never) == ""
    assert dispatcher.calls == ["cancel_dispatch"]


def test_a_dispatcher_that_is_gone_is_not_waited_for(dispatcher: Any, unlimited: DispatchClient) -> None:
    def dies() -> None:
        dispatcher.there = False

    dispatcher.on_cancel = dies
    assert unlimited.free(never).endswith("/dispatcher is gone")


def test_a_dispatcher_that_takes_no_cancel_is_not_waited_for_without_end(
    dispatcher: Any, impatient: DispatchClient
) -> None:
    dispatcher.takes_cancel = False
    assert impatient.free(never).endswith("carries out an earlier plan and does not stop")


def test_an_executor_that_starts_does_not_wait_without_end(
    dispatcher: Any, unlimited: DispatchClient
) -> None:
    assert unlimited.free(never, 0.05).endswith("does not stop")


def test_plans_of_others_are_waited_for_once_in_all(dispatcher: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch_client, "STATUS_GRACE", 0.0)
    client = dispatcher.client(cancel_deadline=LONG)
    dispatcher.status(DispatchStatus.RUNNING)
    dispatcher.owner("/other")

    def overtaken(ended: Callable[[ClientGoal], None]) -> None:
        """Another client has been faster, after the plan before was waited for."""
        dispatcher.passed += 2 * LONG
        dispatcher.owner("/other")
        dispatcher.status(DispatchStatus.RUNNING)
        goal = ClientGoal(GoalID(), lambda goal: None, None, None)
        goal.finish(GoalStatus.REJECTED, "the plan is being dispatched already", None)
        ended(goal)

    dispatcher.on_dispatch = overtaken

    def interruptible(interrupt: Optional[Callable[[], None]]) -> None:
        if not dispatcher.calls:  # the plan before ends while it is waited for
            dispatcher.status(DispatchStatus.IDLE)

    result = client.dispatch(interruptible)
    assert dispatcher.calls == ["goal"]
    assert result.reason.endswith("carries out a plan of /other")
