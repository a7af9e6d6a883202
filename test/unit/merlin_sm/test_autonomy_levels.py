# SPDX-License-Identifier: Apache-2.0
"""Outcomes above the autonomy level wait until operators confirm them or force others; a cancel wins."""

import threading

import pytest
from outcome_world import Work, World

import smach
from merlin_sm.holding.outcomes import Outcomes
from merlin_sm.holding.state_holds import GRACE, StateHolds
from merlin_sm.holding.state_hook import hook_states
from merlin_sm.merlin_sm import MerlinSM
from merlin_test import LONG


@pytest.fixture
def high():
    """Its outcome `succeeded` requires the level `high`, `nothing` requires `full`."""
    made = World(succeeded="high", nothing="full")
    made.outcomes.set_level("low")
    yield made
    made.machine.cancel()


def test_at_level_full_nothing_waits():
    world = World(succeeded="full")
    assert world.outcomes.level == "full" and not world.holds.limited
    world.work.go.set()
    world.begin()
    assert world.end() == "succeeded"
    assert world.left == []


def test_an_outcome_above_the_level_waits_until_it_is_confirmed(high):
    high.work.go.set()
    high.begin()
    high.wait_unconfirmed("succeeded")
    assert high.runs == ["FIRST", "WORK"]
    high.holds.go_on()
    high.holds.step()  # of breakpoints; they confirm nothing
    assert high.holds.unconfirmed == [("DO/WORK", "succeeded")]
    assert high.outcomes.leave("DO/WORK", "", "Ana") == (
        "DO/WORK is left with succeeded. Nothing has set found."
    )
    assert high.end() == "succeeded"
    assert high.runs == ["FIRST", "WORK", "SEE"]
    assert high.left == [("DO/WORK", "Ana", "succeeded", "succeeded", "", ())]
    assert high.work.reason == ""


def test_instead_of_its_own_another_outcome_is_forced(high):
    high.work.go.set()
    high.begin()
    high.wait_unconfirmed("succeeded")
    high.outcomes.leave("DO/WORK", "nothing", "Ana")
    assert high.end() == "succeeded"
    assert high.runs == ["FIRST", "WORK", "LOOK"]  # though it requires a level, too
    assert high.left == [("DO/WORK", "Ana", "nothing", "succeeded", "", ("found",))]


def test_a_forced_outcome_is_not_confirmed_again(high):
    high.begin()
    assert high.work.runs_now.wait(LONG)
    high.outcomes.leave("DO/WORK", "nothing", "Ana")
    assert high.end() == "succeeded"
    assert high.runs == ["FIRST", "WORK", "LOOK"]


def test_a_higher_level_lets_go_what_it_allows(high):
    high.work.go.set()
    high.work.ends = "nothing"
    high.begin()
    high.wait_unconfirmed("nothing")
    high.outcomes.set_level("high")
    assert high.holds.unconfirmed == [("DO/WORK", "nothing")]
    with pytest.raises(ValueError, match="'medium' is not an autonomy level; there are off, low, high, full"):
        high.outcomes.set_level("medium")
    high.outcomes.set_level("full")
    assert high.end() == "succeeded"
    assert high.runs == ["FIRST", "WORK", "LOOK"] and high.left == []
    assert not high.holds.armed and not high.holds.limited


def test_a_level_that_is_reached_needs_no_confirmation(high):
    high.outcomes.set_level("high")
    high.work.go.set()
    high.begin()
    assert high.end() == "succeeded"
    assert high.runs == ["FIRST", "WORK", "SEE"] and high.left == []


@pytest.mark.parametrize("wished", [False, True])
def test_a_cancel_ends_the_wait_and_the_outcome_is_not_taken(high, wished):
    high.work.go.set()
    high.begin()
    high.wait_unconfirmed("succeeded")
    if wished:
        release = high.holds.release

        def first_cancelled(state):
            high.holds.release = release
            high.machine.cancel()
            release(state)

        high.holds.release = first_cancelled
        high.outcomes.leave("DO/WORK", "nothing", "Ana")
    else:
        high.machine.cancel()
    assert high.end() == "preempted"
    assert high.runs == ["FIRST", "WORK"]
    assert [left.refused for left in high.left] == (["it was cancelled first"] if wished else [])
    assert (high.work.outcome, high.work.reason) == ("preempted", "cancelled")
    assert high.holds.unconfirmed == [] and not high.holds.armed
    high.outcomes.set_level("full")
    high.begin()
    assert high.end() == "succeeded"


class Twice:
    """A machine whose state TRY is run, left by LOOK, and run again; its outcome requires `high`."""

    def __init__(self, cancel):
        self.tried, self.changed = [], threading.Condition()
        self.holds = StateHolds()
        self.holds.on_change = self.notify
        self.outcomes = Outcomes(self.holds)
        self.outcomes.set_level("off")
        self.machine = MerlinSM(["again"])
        self.state = smach.CBState(self.run, outcomes=["again", "preempted"])
        look = smach.CBState(lambda _: cancel(self.state) or "go", outcomes=["go"])
        with self.machine:
            self.machine.add("TRY", self.state, {"preempted": "LOOK"}, autonomy={"again": "high"})
            self.machine.add("LOOK", look, {"go": "TRY"})
        hook_states(self.machine, "DO", self.outcomes)
        self.ended = False
        self.thread = threading.Thread(target=self.live, daemon=True)

    def live(self):
        self.machine.execute()
        self.ended = True
        self.notify()

    def run(self, userdata):
        self.tried.append(len(self.tried))
        return "again"

    def notify(self):
        with self.changed:
            self.changed.notify_all()

    def wait(self, waits):
        with self.changed:
            assert self.changed.wait_for(waits, LONG)

    def ends_when_confirmed(self):
        self.wait(lambda: self.holds.unconfirmed or self.ended)
        assert self.holds.unconfirmed == [("DO/TRY", "again")]
        self.outcomes.leave("DO/TRY", "", "Ana")
        self.thread.join(LONG)
        assert not self.thread.is_alive() and len(self.tried) == 1


def test_after_a_cancel_before_it_was_entered_an_outcome_of_the_next_entry_waits():
    twice = Twice(lambda state: None)
    twice.holds.set(["DO/TRY"])
    twice.thread.start()
    twice.wait(lambda: twice.holds.waiting == ["DO/TRY"])
    twice.holds.set([])
    twice.machine.request_preempt()
    twice.ends_when_confirmed()


def test_after_a_cancel_that_came_too_late_an_outcome_of_the_next_entry_waits():
    twice = Twice(lambda state: state.request_preempt())
    twice.machine.set_initial_state(["LOOK"])
    twice.thread.start()
    twice.ends_when_confirmed()


def test_without_a_console_it_is_left_as_it_ended_and_the_level_is_the_usual_one(high):
    said = []
    high.holds.on_lost = said.append
    high.holds.set_level(2, usual=True)
    high.outcomes.set_level("low")
    high.work.go.set()
    high.begin()
    high.wait_unconfirmed("succeeded")
    high.clock.now += GRACE - 1
    high.holds.followed()
    high.clock.now += GRACE
    assert high.holds.unconfirmed == [("DO/WORK", "succeeded")]
    high.clock.now += 1
    assert high.end() == "succeeded"
    assert high.runs == ["FIRST", "WORK", "SEE"]
    assert high.left == [("DO/WORK", "", "succeeded", "succeeded", "", ())]
    assert high.outcomes.level == "high"
    assert "no console for 30 s: DO/WORK goes on" in said[0] and "level is high" in said[0]


def test_levels_are_checked_where_they_are_written():
    machine = MerlinSM(["succeeded", "aborted", "preempted"])
    with machine:
        with pytest.raises(ValueError, match="autonomy of GO: the state has no outcome 'done'"):
            machine.add("GO", Work([]), autonomy={"done": "high"})
        with pytest.raises(ValueError, match="'higher' is not an autonomy level"):
            machine.add_auto("GO", Work([]), ["succeeded"], autonomy={"succeeded": "higher"})
        machine.add("GO", Work([]), {"nothing": "succeeded"}, autonomy={"succeeded": "high"})
    outcomes = Outcomes(StateHolds())
    assert outcomes.level == ""
    hook_states(machine, "DO", outcomes)
    assert outcomes.level == "full"
