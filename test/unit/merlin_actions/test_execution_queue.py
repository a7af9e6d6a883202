"""Executions of one operator: each gets one answer, and no two run at once unless they may."""

from hypothesis import given
from hypothesis import strategies as st

from merlin_actions.core.ending import Closing, Ending, after_closing, closing_of
from merlin_actions.core.execution_queue import ExecutionQueue, QueueDecision, QueueStep

FIRST, SECOND, OTHER_PLAN = (1, 0), (1, 1), (2, 0)


def test_a_second_execution_waits_for_the_end_of_the_first():
    queue = ExecutionQueue(concurrent=False)
    assert queue.arrive(FIRST) == [QueueDecision(QueueStep.RUN, FIRST)]
    assert queue.arrive(SECOND) == [QueueDecision(QueueStep.WAIT, SECOND)]
    assert queue.end(FIRST) == [QueueDecision(QueueStep.RUN, SECOND)]


def test_it_does_not_wait_for_ever():
    queue = ExecutionQueue(concurrent=False)
    queue.arrive(FIRST)
    queue.arrive(SECOND)
    (refused,) = queue.waited_too_long(SECOND)
    assert (refused.what, refused.key) == (QueueStep.REFUSE, SECOND)
    assert "runs already" in refused.reason
    assert queue.end(FIRST) == []


def test_a_newer_plan_interrupts_what_the_older_one_has_left():
    queue = ExecutionQueue(concurrent=False)
    queue.arrive(FIRST)
    waits, interrupts = queue.arrive(OTHER_PLAN)
    assert (waits.what, interrupts.what, interrupts.key) == (QueueStep.WAIT, QueueStep.INTERRUPT, FIRST)


def test_an_execution_that_is_dispatched_twice_runs_once():
    queue = ExecutionQueue(concurrent=True)
    queue.arrive(FIRST)
    assert queue.arrive(FIRST) == []


_keys = st.tuples(st.integers(1, 2), st.integers(0, 2))
_events = st.tuples(st.sampled_from(["arrive", "cancel", "end", "late"]), _keys)


@given(st.booleans(), st.lists(_events, max_size=60))
def test_each_execution_ends_once_and_no_two_run_at_once(concurrent, events):
    queue = ExecutionQueue(concurrent)
    running, waiting = set(), set()

    def carry_out(decisions):
        for decision in decisions:
            key = decision.key
            if decision.what is QueueStep.RUN:
                assert key not in running
                assert concurrent or not running
                waiting.discard(key)
                running.add(key)
            elif decision.what is QueueStep.WAIT:
                assert key not in waiting
                waiting.add(key)
            elif decision.what is QueueStep.REFUSE:
                waiting.remove(key)
                assert decision.reason
            else:
                assert key in running

    for event, key in events:
        if event == "arrive":
            carry_out(queue.arrive(key))
        elif event == "cancel":
            carry_out(queue.cancel(key, "cancelled"))
        elif event == "late":
            carry_out(queue.waited_too_long(key))
        elif key in running:
            running.remove(key)
            carry_out(queue.end(key))
        assert running or not waiting
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
