"""The goals of state machines: one at a time in each, each answered, none in the way for ever."""

from hypothesis import given
from hypothesis import strategies as st

from merlin_actions.core.machine_slot import MachineSlot, SlotDecision, SlotStep


def kinds(decisions):
    return [(decision.what, decision.goal) for decision in decisions]


def test_a_newer_goal_preempts_the_older_and_starts_after_it():
    slot = MachineSlot()
    assert slot.arrive("a") == [SlotDecision(SlotStep.START, "a")]
    assert kinds(slot.arrive("b")) == [(SlotStep.PREEMPT, "a")]
    assert kinds(slot.end("a")) == [(SlotStep.START, "b")]


def test_a_run_that_does_not_stop_is_abandoned():
    slot = MachineSlot()
    slot.arrive("a")
    assert kinds(slot.cancel("a", "cancelled")) == [(SlotStep.PREEMPT, "a")]
    slot.arrive("b")
    assert kinds(slot.limit_passed("a")) == [(SlotStep.ABANDON, "a"), (SlotStep.START, "b")]
    assert slot.end("a") == []  # late, and of no interest any more


def test_a_limit_without_a_preempt_does_nothing():
    slot = MachineSlot()
    slot.arrive("a")
    assert slot.limit_passed("a") == []
    assert slot.running == ["a"]


def test_with_two_machines_the_third_goal_preempts_the_oldest():
    slot = MachineSlot(machines=2)
    slot.arrive("a")
    assert kinds(slot.arrive("b")) == [(SlotStep.START, "b")]
    assert kinds(slot.arrive("c")) == [(SlotStep.PREEMPT, "a")]
    assert kinds(slot.end("b")) == [(SlotStep.START, "c")]
    assert slot.running == ["a", "c"]


def test_a_further_machine_takes_what_waits():
    slot = MachineSlot()
    slot.arrive("a")
    slot.arrive("b")
    assert kinds(slot.resize(2)) == [(SlotStep.START, "b")]
    assert kinds(slot.cancel_all("over")) == [(SlotStep.PREEMPT, "b")]


def test_when_all_have_to_stop_the_one_that_waits_does_not_begin():
    slot = MachineSlot()
    slot.arrive("a")
    slot.arrive("b")  # which preempts the first
    assert kinds(slot.cancel_all("the master is lost")) == [(SlotStep.RECALL, "b")]
    assert slot.end("a") == []


_events = st.tuples(st.sampled_from(["arrive", "cancel", "end", "limit"]), st.integers(0, 5))


@given(st.integers(1, 3), st.lists(_events, max_size=60))
def test_every_goal_is_answered_and_a_machine_runs_one_at_a_time(machines, events):
    slot = MachineSlot(machines)
    running, open_goals = [], set()
    number = 0

    def carry_out(decisions):
        for what, goal, _ in decisions:
            if what is SlotStep.START:
                running.append(goal)
                assert len(running) <= machines
            elif what is SlotStep.PREEMPT:
                assert goal in running
            elif what is SlotStep.ABANDON:
                running.remove(goal)
                open_goals.remove(goal)
            else:
                assert goal not in running
                open_goals.remove(goal)

    for event, choice in events:
        if event == "arrive":
            number += 1
            open_goals.add(str(number))
            carry_out(slot.arrive(str(number)))
            continue
        goal = str(max(1, number - choice))
        if event == "cancel":
            carry_out(slot.cancel(goal, "cancelled"))
        elif event == "limit":
            carry_out(slot.limit_passed(goal))
        elif goal in running:
            running.remove(goal)
            open_goals.remove(goal)
            carry_out(slot.end(goal))
        assert slot.running == running
        assert len(open_goals) <= machines + 1
    while running:
        goal = running.pop()
        open_goals.remove(goal)
        carry_out(slot.end(goal))
    assert not open_goals
