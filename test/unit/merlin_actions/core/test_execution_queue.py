"""Executions of one operator: each gets one answer, and no more run at once than may."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_actions.core.ending import Closing, Ending, after_closing, closing_of
from merlin_actions.core.execution_queue import WAITING, ExecutionQueue, QueueDecision, QueueStep, at_once

FIRST, SECOND, OTHER_PLAN = (1, 0), (1, 1), (2, 0)


def test_a_second_execution_waits_for_the_end_of_the_first():
    queue = ExecutionQueue()
    assert queue.arrive(FIRST) == [QueueDecision(QueueStep.RUN, FIRST)]
    assert queue.arrive(SECOND) == [QueueDecision(QueueStep.WAIT, SECOND)]
    assert queue.end(FIRST) == [QueueDecision(QueueStep.RUN, SECOND)]


def test_it_does_not_wait_for_ever():
    queue = ExecutionQueue()
    queue.arrive(FIRST)
    queue.arrive(SECOND)
    (refused,) = queue.waited_too_long(SECOND)
    assert (refused.what, refused.key) == (QueueStep.REFUSE, SECOND)
    assert "runs already" in refused.reason
    assert queue.end(FIRST) == []


def test_what_waits_does_not_grow_without_end():
    queue = ExecutionQueue()
    queue.arrive(FIRST)
    steps = [queue.arrive((1, number))[0] for number in range(1, 2 * WAITING)]
    assert [step.what for step in steps] == [QueueStep.WAIT] * WAITING + [QueueStep.REFUSE] * (WAITING - 1)
    assert f"{WAITING} wait already" in steps[-1].reason
    assert queue.end(FIRST) == [QueueDecision(QueueStep.RUN, (1, 1))]
    assert queue.arrive((1, 9999))[0].what is QueueStep.WAIT


def test_a_newer_plan_interrupts_what_the_older_one_has_left():
    queue = ExecutionQueue()
    queue.arrive(FIRST)
    waits, interrupts = queue.arrive(OTHER_PLAN)
    assert (waits.what, interrupts.what, interrupts.key) == (QueueStep.WAIT, QueueStep.INTERRUPT, FIRST)


def test_an_execution_that_is_dispatched_twice_runs_once():
    queue = ExecutionQueue(limit=0)
    queue.arrive(FIRST)
    assert queue.arrive(FIRST) == []


def test_lanes_do_not_wait_for_each_other():
    queue = ExecutionQueue()
    queue.arrive(FIRST, "ann")
    assert queue.arrive(SECOND, "bob") == [QueueDecision(QueueStep.RUN, SECOND)]
    assert queue.arrive(OTHER_PLAN, "bob") == [
        QueueDecision(QueueStep.WAIT, OTHER_PLAN),
        QueueDecision(QueueStep.INTERRUPT, SECOND, "plan 2 has taken the place of plan 1"),
    ]
    assert queue.end(FIRST) == []
    assert queue.end(SECOND) == [QueueDecision(QueueStep.RUN, OTHER_PLAN)]


def test_what_waits_runs_as_soon_as_more_may():
    queue = ExecutionQueue()
    for key in (FIRST, SECOND, (1, 2), (1, 3)):
        queue.arrive(key)
    assert queue.allow(3) == [QueueDecision(QueueStep.RUN, SECOND), QueueDecision(QueueStep.RUN, (1, 2))]
    assert queue.end(FIRST) == [QueueDecision(QueueStep.RUN, (1, 3))]


@pytest.mark.parametrize("said, limit", [(False, 1), (True, 0), (1, 1), (3, 3), (0, 1)])
def test_a_class_says_how_many_run_at_once(said, limit):
    assert at_once(said) == limit


_keys = st.tuples(st.integers(1, 2), st.integers(0, 3))
_events = st.tuples(st.sampled_from(["arrive", "cancel", "end", "late", "allow"]), _keys)


@given(st.integers(0, 3), st.lists(_events, max_size=60))
def test_each_execution_ends_once_and_no_more_run_than_may(limit, events):
    queue = ExecutionQueue(limit)
    running, waiting, stopped = set(), set(), set()

    def lane(key):
        return "ann" if key[1] % 2 else "bob"

    def carry_out(decisions):
        for decision in decisions:
            key = decision.key
            if decision.what is QueueStep.RUN:
                assert key not in running
                waiting.discard(key)
                running.add(key)
                assert not limit or sum(lane(other) == lane(key) for other in running) <= limit
            elif decision.what is QueueStep.WAIT:
                assert key not in waiting
                waiting.add(key)
            elif decision.what is QueueStep.REFUSE:
                waiting.remove(key)
                assert decision.reason
            else:
                assert key in running and key not in stopped
                stopped.add(key)

    for event, key in events:
        if event == "arrive":
            carry_out(queue.arrive(key, lane(key)))
        elif event == "cancel":
            carry_out(queue.cancel(key, "cancelled"))
        elif event == "late":
            carry_out(queue.waited_too_long(key))
        elif event == "allow":
            limit = key[1]
            carry_out(queue.allow(limit))
        elif key in running:
            running.remove(key)
            stopped.discard(key)
            carry_out(queue.end(key))
        for waits in waiting:
            assert any(lane(key) == lane(waits) for key in running), "it waits for an end"
    carry_out(queue.cancel_all("the end"))
    assert not waiting
    for key in list(running):
        running.discard(key)
        carry_out(queue.end(key))
    assert queue.idle


@given(st.builds(Ending, st.booleans(), st.text(max_size=3), st.booleans(), st.text(max_size=3)))
def test_effects_count_only_when_they_came_true(ending):
    closing = closing_of(ending)
    assert (closing is Closing.END) == ending.succeeded
    assert (closing is Closing.ROLLBACK) == (not ending.succeeded and not ending.begun)
    assert after_closing(ending, []) == ending
    failed = after_closing(ending, ["the disk is full"])
    assert not failed.succeeded and "the disk is full" in failed.reason
    assert failed.unstopped == ending.unstopped
