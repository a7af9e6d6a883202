# SPDX-License-Identifier: Apache-2.0
"""What a host answers for a run, and what a bridge makes of it."""

from types import SimpleNamespace
from typing import Any

import pytest

from merlin_actions.core.ending import (
    GIVEN_UP,
    NOT_BEGUN,
    Ending,
    MachineEnd,
    answer_of,
    ending_of,
    information_of,
)
from merlin_actions.core.execution import Execution
from merlin_ros.work.goal_end import GoalEnd

ABORTED = MachineEnd("aborted", "the door is closed")


@pytest.fixture
def execution() -> Execution:
    parameters = [SimpleNamespace(key=key, value=value) for key, value in (("b", "box_1"), ("p", "attic"))]
    dispatch: Any = SimpleNamespace(plan_id=3, action_id=1, name="bring", parameters=parameters)
    return Execution(dispatch, parameters)


def test_a_machine_that_succeeded_has_nothing_else_to_say(execution: Execution) -> None:
    how, end = answer_of(MachineEnd("succeeded", "late words", about="attic"), "bring", "cancelled")
    assert (how, end) == (GoalEnd.SUCCEEDED, MachineEnd("succeeded"))
    assert ending_of(how, end, execution) == Ending(True)


@pytest.mark.parametrize("cancel_reason", [None, "a newer goal came"])
def test_what_did_not_stop_is_named_before_all(cancel_reason: Any, execution: Execution) -> None:
    how, end = answer_of(MachineEnd("preempted", "", "sound_play"), "bring", cancel_reason)
    assert how is GoalEnd.ABORTED and end.reason == "sound_play did not stop when bring was cancelled"
    execution.cancel()
    ending = ending_of(how, end, execution)
    assert (ending.succeeded, ending.begun, ending.unstopped) == (False, True, "sound_play")
    assert ending.reason == end.reason


def test_a_cancelled_machine_ends_as_cancelled(execution: Execution) -> None:
    how, end = answer_of(MachineEnd("preempted"), "bring", "a newer goal came")
    assert (how, end.reason) == (GoalEnd.PREEMPTED, "a newer goal came")
    execution.cancel("cancelled by its client")
    assert ending_of(how, end, execution) == Ending(False, "cancelled by its client", begun=True)


def test_a_machine_that_preempts_itself_has_failed(execution: Execution) -> None:
    how, end = answer_of(MachineEnd("preempted"), "bring", None)
    assert (how, end.reason) == (GoalEnd.ABORTED, "the machine ended with preempted")
    assert ending_of(how, end, execution).reason == "the machine ended with preempted"


def test_a_failure_that_a_cancel_overtook_keeps_its_own_reason(execution: Execution) -> None:
    how, end = answer_of(ABORTED, "bring", "cancelled")
    assert (how, end) == (GoalEnd.ABORTED, ABORTED)
    execution.cancel()
    assert ending_of(how, end, execution).reason == "the door is closed"


@pytest.mark.parametrize("how", [GoalEnd.RECALLED, GoalEnd.REJECTED])
def test_a_goal_that_never_ran_has_changed_nothing(how: GoalEnd, execution: Execution) -> None:
    ending = ending_of(how, MachineEnd(), execution, "busy")
    assert (ending.succeeded, ending.begun, ending.reason) == (False, False, "busy")
    assert (
        ending_of(how, MachineEnd(), execution).reason
        == f"(bring box_1 attic) was {how.name.lower()} without a reason"
    )


def test_a_machine_that_is_gone_may_have_done_something(execution: Execution) -> None:
    ending = ending_of(GoalEnd.LOST, MachineEnd(), execution, "its process is gone")
    assert ending == Ending(False, "the state machine of (bring box_1 attic) is gone: its process is gone")
    assert ending.begun


@pytest.mark.parametrize(("outcome", "begun"), [(GIVEN_UP, True), (NOT_BEGUN, False)])
def test_what_another_try_cannot_help_is_named(outcome: str, begun: bool, execution: Execution) -> None:
    how, end = answer_of(MachineEnd(outcome, "no such place", about="attic"), "bring", None)
    ending = ending_of(how, end, execution)
    assert (ending.begun, ending.no_retry) == (begun, "(bring * attic)")
    assert information_of(ending) == {"reason": "no such place", "final": "(bring * attic)"}


def test_what_does_not_stop_is_reported_to_the_dispatcher() -> None:
    assert information_of(Ending(False, "it hangs", unstopped="move_base")) == {
        "reason": "it hangs",
        "stopped": "no",
    }
    assert information_of(Ending(True, "done", unstopped="move_base")) == {}


@pytest.mark.parametrize("status", [0, 1, 7, 200])
def test_a_number_that_ends_no_goal_is_an_abort(status: int, execution: Execution) -> None:
    ending = ending_of(GoalEnd(status), MachineEnd(), execution)
    assert ending.reason == "(bring box_1 attic) was aborted without a reason" and ending.begun
