# SPDX-License-Identifier: Apache-2.0
"""Operators force the outcomes with which states are left; a cancel wins."""

import enum
import threading

import pytest
from outcome_world import World

import smach
from merlin_pddl.breakpoints import BreakpointError
from merlin_sm.holding.outcomes import NoSuchState, Outcomes
from merlin_sm.holding.state_holds import StateHolds
from merlin_sm.holding.state_hook import hook_states
from merlin_sm.merlin_sm import MerlinSM
from merlin_test import LONG


@pytest.fixture
def world():
    made = World()
    yield made
    made.machine.cancel()
    made.work.stop.set()


def test_a_running_state_is_preempted_and_left_when_it_has_really_ended(world):
    world.work.stop.clear()
    world.begin()
    assert world.work.runs_now.wait(LONG)
    said = world.outcomes.leave("do/work", "nothing", "Ana")
    assert said == (
        "DO/WORK is preempted; when it has stopped, it is left with nothing. Nothing has set found."
    )
    assert world.work.stopping.wait(LONG)
    assert world.runs == ["FIRST", "WORK"] and world.left == []
    world.work.stop.set()
    assert world.end() == "succeeded"
    assert world.runs == ["FIRST", "WORK", "LOOK"]
    assert world.left == [("DO/WORK", "Ana", "nothing", "preempted", "", ("found",))]
    assert (world.work.outcome, world.work.reason) == ("nothing", "forced by Ana")
    world.work.go.clear()
    world.work.runs_now.clear()
    world.begin()  # nothing of it is left
    assert world.work.runs_now.wait(LONG)
    world.work.go.set()
    assert world.end() == "succeeded"
    assert world.runs[3:] == ["FIRST", "WORK", "SEE"]
    assert len(world.left) == 1


def test_one_that_ends_with_another_outcome_than_preempted_is_left_too(world):
    world.work.run = lambda userdata: (world.work.runs_now.set(), world.work.stop.wait(LONG)) and "succeeded"
    world.work.stop.clear()
    flags = []
    world.outcomes.on_left = lambda left: (
        flags.append(world.work.preempt_requested()),
        world.left.append(left),
    )
    world.begin()
    assert world.work.runs_now.wait(LONG)
    world.outcomes.leave("DO/WORK", "nothing", "Ana")
    world.work.stop.set()
    assert world.end() == "succeeded"
    assert flags == [False], "the original SMACH would preempt its next run"
    assert world.runs == ["FIRST", "LOOK"]
    assert world.left == [("DO/WORK", "Ana", "nothing", "succeeded", "", ("found",))]


def test_the_last_wish_counts_and_the_state_is_preempted_once(world):
    world.work.stop.clear()
    world.begin()
    assert world.work.runs_now.wait(LONG)
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert world.work.stopping.wait(LONG)
    world.outcomes.leave("DO/WORK", "aborted", "Ben")
    world.work.stop.set()
    assert world.end() == "aborted"
    assert [left[1:4] for left in world.left] == [("Ben", "aborted", "preempted")]
    assert world.machine.reason == "forced by Ben"


def test_one_that_is_held_is_left_without_being_entered(world):
    world.holds.set(["DO/WORK"])
    world.begin()
    world.wait(lambda: world.holds.waiting == ["DO/WORK"])
    said = world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert said == "DO/WORK is left with succeeded, without being entered. Nothing has set found."
    assert world.end() == "succeeded"
    assert world.runs == ["FIRST", "SEE"]
    assert world.left == [("DO/WORK", "Ana", "succeeded", "", "", ("found",))]
    assert world.holds.waiting == []


def test_what_cannot_be_is_refused_with_a_reason(world):
    def why(path, outcome):
        with pytest.raises(BreakpointError) as refused:
            world.outcomes.leave(path, outcome, "Ana")
        return str(refused.value)

    world.begin()
    assert world.work.runs_now.wait(LONG)
    assert why("DO/WORK", "done") == (
        "DO/WORK has no outcome 'done'; it has succeeded, aborted, preempted, nothing"
    )
    assert why("DO/WORK", "") == "DO/WORK does not wait for a confirmation"
    assert why("DO/SEE", "succeeded") == "DO/SEE neither runs nor is held"
    assert "is not a state" in why("DO", "succeeded")
    with pytest.raises(NoSuchState, match="no machine has a state DO/FLY"):
        world.outcomes.leave("DO/FLY", "succeeded", "Ana")
    world.work.stop.clear()
    world.machine.cancel()
    assert world.work.stopping.wait(LONG)
    assert why("DO/WORK", "succeeded") == "DO/WORK is being cancelled, which comes first"
    world.work.stop.set()
    assert world.end() == "preempted"
    assert world.left == []


def test_two_runs_of_one_state_are_not_mistaken_for_each_other(world):
    other = World()
    hook_states(other.machine, "DO", world.outcomes)
    for each in (world, other):
        each.begin()
        assert each.work.runs_now.wait(LONG)
    with pytest.raises(BreakpointError, match="runs 2 times at once"):
        world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    other.machine.cancel()
    assert other.end() == "preempted"
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert world.end() == "succeeded"


def test_what_did_not_stop_keeps_its_own_outcome(world):
    world.begin()
    assert world.work.runs_now.wait(LONG)
    world.work.unstopped = "/move_base"
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert world.end() == "aborted"
    assert world.left == [("DO/WORK", "Ana", "succeeded", "aborted", "/move_base did not stop", ())]
    assert world.machine.reason == "it did not stop"


def test_one_that_raises_is_not_left_as_wished(world):
    world.work.ends = None
    world.work.run = lambda userdata: (world.work.runs_now.set(), world.work.go.wait(LONG), 1 / 0)
    world.begin()
    assert world.work.runs_now.wait(LONG)
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    world.work.go.set()
    assert isinstance(world.end(), smach.SmachError)
    assert world.left == [("DO/WORK", "Ana", "succeeded", "", "it has raised an exception", ())]


def test_a_machine_within_a_machine_is_left_with_all_that_runs_in_it(world):
    outer = MerlinSM(["succeeded", "aborted", "preempted"])
    with outer:
        outer.add("INNER", world.machine, {"aborted": "AFTER"})
        outer.add("AFTER", world.note("AFTER"))
    outcomes = Outcomes(world.holds)
    outcomes.on_left = world.left.append
    hook_states(outer, "OUTER", outcomes)
    world.machine, inner = outer, world.machine
    world.begin()
    assert world.work.runs_now.wait(LONG)
    outcomes.leave("OUTER/INNER", "aborted", "Ana")
    assert world.end() == "succeeded"
    assert world.runs == ["FIRST", "WORK", "AFTER"]
    assert [left[:4] for left in world.left] == [("OUTER/INNER", "Ana", "aborted", "preempted")]
    assert inner.reason == "forced by Ana"


# --- the cancel wins ---------------------------------------------------------------------------------------


def test_a_cancel_after_the_wish_wins_as_long_as_the_state_has_not_been_left(world):
    world.work.stop.clear()
    world.begin()
    assert world.work.runs_now.wait(LONG)
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert world.work.stopping.wait(LONG)
    world.machine.cancel()
    world.work.stop.set()
    assert world.end() == "preempted"
    assert world.runs == ["FIRST", "WORK"]
    assert world.left == [("DO/WORK", "Ana", "succeeded", "preempted", "it was cancelled first", ())]


@pytest.mark.parametrize("how", ["whole", "on its way", "this state alone"])
def test_a_cancel_between_the_end_of_the_state_and_its_outcome_wins(world, how):
    entered = world.work.service_preempt
    cancel = {
        "whole": world.machine.cancel,
        "on its way": lambda: smach.State.request_preempt(world.machine),
        "this state alone": world.work.request_preempt,  # by a state beside it
    }[how]

    def served():  # the state has stopped, SMACH does not know yet
        world.work.service_preempt = entered
        entered()
        cancel()

    world.begin()
    assert world.work.runs_now.wait(LONG)
    world.work.service_preempt = served
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert world.end() == "preempted"
    assert world.runs == ["FIRST", "WORK"]
    assert [left.refused for left in world.left] == ["it was cancelled first"]


def test_a_cancel_after_the_forced_outcome_preempts_what_comes_next(world):
    world.outcomes.on_left = lambda left: (world.left.append(left), world.machine.cancel())
    world.begin()
    assert world.work.runs_now.wait(LONG)
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert world.end() == "preempted"
    assert world.runs == ["FIRST", "WORK"]
    assert [left.refused for left in world.left] == [""]


def test_wish_and_cancel_at_once_and_nothing_begins_after_the_cancel():
    for _ in range(40):
        world = World()
        cancelled, late = threading.Event(), []
        world.see.register(lambda late=late, cancelled=cancelled: late.append(cancelled.is_set()))
        world.begin()
        assert world.work.runs_now.wait(LONG)
        ready = threading.Barrier(2, timeout=LONG)

        def wish(world=world, ready=ready):
            ready.wait()
            try:
                world.outcomes.leave("DO/WORK", "succeeded", "Ana")
            except BreakpointError as error:
                assert "cancelled" in str(error) or "left" in str(error) or "neither" in str(error)

        def cancel(world=world, ready=ready, cancelled=cancelled):
            ready.wait()
            world.machine.cancel()
            cancelled.set()

        threads = [threading.Thread(target=each, daemon=True) for each in (cancel, wish)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(LONG)
        # The forced outcome may have come first; SEE has begun then before the cancel had returned.
        assert world.end() == "preempted" or late == [False]
        assert True not in late


def test_a_cancel_ends_the_hold_though_a_wish_has_come(world):
    world.holds.set(["DO/WORK"])
    world.begin()
    world.wait(lambda: world.holds.waiting == ["DO/WORK"])
    release = world.holds.release

    def first_cancelled(state):
        world.holds.release = release
        world.machine.cancel()
        release(state)

    world.holds.release = first_cancelled
    world.outcomes.leave("DO/WORK", "succeeded", "Ana")
    assert world.end() == "preempted"
    assert world.runs == ["FIRST"]
    assert [left.refused for left in world.left] == ["it was cancelled first"]


def test_a_machine_that_is_left_as_wished_has_not_given_up(world):
    world.work.run = lambda userdata: (
        world.work.runs_now.set() or world.work.stop.wait(LONG) and world.work.give_up("no cup", "cup")
    )
    world.work.stop.clear()
    outer = MerlinSM(["succeeded", "aborted", "preempted"])
    with outer:
        outer.add("INNER", world.machine)
    hook_states(outer, "OUTER", world.outcomes)
    ended = []
    thread = threading.Thread(target=lambda: ended.append(outer.execute(smach.UserData())), daemon=True)
    thread.start()
    assert world.work.runs_now.wait(LONG)
    world.outcomes.leave("OUTER/INNER", "aborted", "Ana")
    world.work.stop.set()
    thread.join(LONG)
    assert ended == ["aborted"]
    assert (outer.reason, outer.given_up, outer.about) == ("forced by Ana", False, "")


class Part(enum.Enum):
    """Labels and outcomes."""

    INNER, WORK, GOOD, BAD = range(4)


def test_labels_and_outcomes_that_are_members_of_an_enumeration():
    left = []
    outcomes = Outcomes(StateHolds())
    outcomes.on_left = left.append
    begun = threading.Event()

    class Work(smach.State):
        def __init__(self):
            super().__init__([Part.GOOD, Part.BAD])
            self.woken = threading.Event()

        def request_preempt(self):
            super().request_preempt()
            self.woken.set()

        def execute(self, userdata):
            begun.set()
            assert self.woken.wait(LONG)
            return Part.BAD

    inner = smach.StateMachine([Part.GOOD, Part.BAD])
    with inner:
        smach.StateMachine.add(Part.WORK, Work())
    machine = MerlinSM([Part.GOOD, Part.BAD])
    with machine:
        machine.add(Part.INNER, inner)
    hook_states(machine, "DO", outcomes)
    ended = []
    thread = threading.Thread(target=lambda: ended.append(machine.execute(smach.UserData())), daemon=True)
    thread.start()
    assert begun.wait(LONG)
    path = "DO/Part.INNER/Part.WORK"
    with pytest.raises(BreakpointError, match="it has Part.GOOD, Part.BAD"):
        outcomes.leave(path, "else", "Ana")
    outcomes.leave(path, "Part.GOOD", "Ana")
    thread.join(LONG)
    assert ended == [Part.GOOD]
    assert left == [(path, "Ana", "Part.GOOD", "Part.BAD", "", ())]
