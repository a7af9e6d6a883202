# SPDX-License-Identifier: Apache-2.0
"""What a client expects of ROSPlan's dispatchers, which publish no status, and of those of MERLIN."""

import threading
from queue import Queue
from typing import Any, List
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_planning import over_rosplan
from merlin_planning.dispatch_progress import Action, DispatchAnswer, DispatchProgress, Reply
from merlin_planning.dispatcher_kind import ReportingDispatcher
from merlin_planning.over_rosplan import FAILURE_GRACE, SilentDispatcher
from merlin_test import LONG

IDLE = DispatchStatus(state=DispatchStatus.IDLE)
RUNNING = DispatchStatus(state=DispatchStatus.RUNNING)
DRIVE = Action(1, 1, "drive", ("hall",))
SAY = Action(2, 1, "say", ("hello",))


@pytest.fixture
def silent(dispatcher: Any) -> SilentDispatcher:
    return SilentDispatcher("/dispatcher", "/kb", threading.Condition(), lambda: None, 20.0)


def reporting(status: DispatchStatus) -> ReportingDispatcher:
    made = ReportingDispatcher(Mock())
    made.receive(status)
    return made


def progress(*actions: Action) -> DispatchProgress:
    made = DispatchProgress()
    for action in actions:
        made.dispatched(action)
    return made


def test_without_a_status_only_what_was_dispatched_shows_that_it_runs(silent: SilentDispatcher) -> None:
    assert not silent.started(progress()), "a cancel now would stop the next dispatch instead"
    assert silent.started(progress(DRIVE))
    failed = progress(DRIVE)
    failed.answered(DRIVE.id, DRIVE.plan_id, DispatchAnswer.FAILED, {})
    assert silent.started(failed)


def test_each_running_action_is_cancelled_where_the_dispatcher_passes_no_cancel_on(
    silent: SilentDispatcher,
) -> None:
    assert silent.cancel(progress(DRIVE, SAY)) == [DRIVE, SAY]
    assert not reporting(RUNNING).cancel(progress(DRIVE, SAY))


def test_an_action_that_no_interface_takes_is_sent_again_while_its_dispatch_lasts(
    silent: SilentDispatcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(over_rosplan, "SEND_AGAIN", 0.01)
    sent: Queue[str] = Queue()
    lost = Action(2, 1, "drive", ("bath",))

    def dispatched(book: DispatchProgress, *actions: Action) -> None:
        for action in actions:
            book.dispatched(action)
            silent.dispatched(action.id, lambda action=action: sent.put(action.text))  # type: ignore[misc]

    book = silent.begin([])
    dispatched(book, DRIVE, SAY._replace(id=3))
    for answer in (DispatchAnswer.TAKEN, DispatchAnswer.SUCCEEDED):
        book.answered(DRIVE.id, DRIVE.plan_id, answer, {})
    dispatched(book, lost)
    assert sent.get(timeout=LONG) == "(drive bath)", "nothing has ever said that it takes (say hello)"
    heard = book.messages
    dispatched(book, lost)  # as its client hears it, too
    assert book.messages == heard, "it does not count as a sign of life"
    dispatched(book, lost._replace(id=4, arguments=("cellar",)))
    silent.end(False)
    book = silent.begin([])
    dispatched(book, lost._replace(arguments=("attic",)))
    assert sent.get(timeout=LONG) == "(drive attic)", "what was lost in a dispatch that has ended stays lost"


@pytest.mark.parametrize("slack", [6.0, None])
def test_a_dispatcher_that_notices_a_failure_gets_the_time_to_stop_the_others(
    silent: SilentDispatcher, slack: float
) -> None:
    assert reporting(RUNNING).failure_grace(slack) == slack
    assert silent.failure_grace(slack) == FAILURE_GRACE


@given(st.lists(st.sampled_from(["begin", "idle", "running"]), max_size=8))
def test_only_a_status_of_this_dispatch_says_that_it_is_over_and_why(events: List[str]) -> None:
    dispatcher = reporting(IDLE)
    state, since_begin = "idle", ["idle"]
    for event in events:
        if event == "begin":
            dispatcher.begin([])
            since_begin = []
        else:
            status = DispatchStatus(
                state=DispatchStatus.IDLE if event == "idle" else DispatchStatus.RUNNING,
                failed_action="(drive hall)",
                reason="the door is shut",
            )
            dispatcher.receive(status)
            state = event
            since_begin.append(event)
    assert dispatcher.busy == (state != "idle")
    assert dispatcher.at_rest == (since_begin[-1:] == ["idle"])
    assert dispatcher.started(progress(DRIVE)) == dispatcher.busy
    reported = any(event != "begin" for event in events) and bool(since_begin)
    result = dispatcher.result(progress(), Reply())
    assert (result.reason == "the door is shut") == reported


def test_answers_have_the_numbers_of_the_message() -> None:
    feedback = ActionFeedback
    numbers = feedback.ACTION_ENABLED, feedback.ACTION_SUCCEEDED_TO_GOAL_STATE, feedback.ACTION_FAILED
    assert tuple(DispatchAnswer) == numbers
