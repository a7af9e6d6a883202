"""What a client expects of ROSPlan's dispatchers, which publish no status, and of those of MERLIN."""

from typing import List

import pytest
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import DispatchStatus

from merlin_sm.dispatching.kinds import FAILURE_GRACE, ReportingDispatcher, SilentDispatcher
from merlin_sm.dispatching.progress import Action, DispatchAnswer, DispatchProgress, Reply

IDLE = DispatchStatus(state=DispatchStatus.IDLE)
RUNNING = DispatchStatus(state=DispatchStatus.RUNNING)
DRIVE = Action(1, 1, "drive", ("hall",))
SAY = Action(2, 1, "say", ("hello",))


def progress(*actions: Action) -> DispatchProgress:
    made = DispatchProgress()
    for action in actions:
        made.dispatched(action)
    return made


def test_without_a_status_only_what_was_dispatched_shows_that_it_runs() -> None:
    silent = SilentDispatcher()
    assert not silent.started(progress()), "a cancel now would stop the next dispatch instead"
    assert silent.started(progress(DRIVE))
    failed = progress(DRIVE)
    failed.answered(DRIVE.id, DRIVE.plan_id, DispatchAnswer.FAILED, {})
    assert silent.started(failed)
    assert not silent.busy and silent.at_rest, "nothing more is to be waited for"


def test_each_running_action_is_cancelled_where_the_dispatcher_passes_no_cancel_on() -> None:
    assert SilentDispatcher().to_cancel(progress(DRIVE, SAY)) == [DRIVE, SAY]
    assert ReportingDispatcher(RUNNING).to_cancel(progress(DRIVE, SAY)) == []


@pytest.mark.parametrize("slack", [6.0, None])
def test_a_dispatcher_that_notices_a_failure_gets_the_time_to_stop_the_others(slack: float) -> None:
    assert ReportingDispatcher(RUNNING).failure_grace(slack) == slack
    assert SilentDispatcher().failure_grace(slack) == FAILURE_GRACE


@given(st.lists(st.sampled_from(["begin", "idle", "running"]), max_size=8))
def test_only_a_status_of_this_dispatch_says_that_it_is_over_and_why(events: List[str]) -> None:
    reporting = ReportingDispatcher(IDLE)
    state, since_begin = "idle", ["idle"]
    for event in events:
        if event == "begin":
            reporting.begin()
            since_begin = []
        else:
            status = DispatchStatus(
                state=DispatchStatus.IDLE if event == "idle" else DispatchStatus.RUNNING,
                failed_action="(drive hall)",
                reason="the door is shut",
            )
            reporting.receive(status)
            state = event
            since_begin.append(event)
    assert reporting.busy == (state != "idle")
    assert reporting.at_rest == (since_begin[-1:] == ["idle"])
    assert reporting.started(progress(DRIVE)) == reporting.busy
    told = any(event != "begin" for event in events) and bool(since_begin)
    result = reporting.result(progress(), Reply())
    assert (result.reason == "the door is shut") == told
