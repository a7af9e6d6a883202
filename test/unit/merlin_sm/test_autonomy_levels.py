# SPDX-License-Identifier: Apache-2.0
"""Outcomes above the autonomy level wait until operators confirm them or force others; a cancel wins."""

import pytest
from outcome_world import Work, World

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
