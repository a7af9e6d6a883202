# SPDX-License-Identifier: Apache-2.0
"""SMACH machines that are held before their states."""

import threading

import pytest

import smach
from merlin_sm.holding.outcomes import Outcomes
from merlin_sm.holding.state_holds import StateHolds
from merlin_sm.holding.state_hook import hook_states
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.function_state import FunctionState
from merlin_test import LONG


class Plain(smach.State):
    """One of SMACH that looks at nothing."""

    def __init__(self, runs, outcomes=("succeeded", "preempted")):
        super().__init__(list(outcomes))
        self.runs = runs

    def execute(self, userdata):
        self.runs.append("PLAIN")
        return "succeeded"


class World:
    """A machine in a thread: FIRST, then INNER/PLAIN, then LAST."""

    def __init__(self):
        self.runs, self.outcome = [], None
        self.holds, self.held = StateHolds(), threading.Event()
        self.holds.on_change = lambda: self.held.set() if self.holds.waiting else self.held.clear()
        self.machine = MerlinSM(["succeeded", "aborted", "preempted"])
        inner = smach.StateMachine(["succeeded", "preempted"])
        with inner:
            smach.StateMachine.add("PLAIN", Plain(self.runs))
        with self.machine:
            self.machine.add("FIRST", self.note("FIRST"), transitions={"succeeded": "INNER"})
            self.machine.add("INNER", inner, transitions={"succeeded": "LAST"})
            self.machine.add("LAST", self.note("LAST"))
        hook_states(self.machine, "WORK", Outcomes(self.holds))

    def note(self, label):
        return FunctionState(lambda userdata: self.runs.append(label))

    def begin(self, *points):
        self.holds.set(points)
        self.machine.prepare()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        self.outcome = self.machine.execute(smach.UserData())

    def wait(self, path):
        assert self.held.wait(LONG)
        assert self.holds.held == path

    def end(self):
        self.thread.join(LONG)
        assert not self.thread.is_alive()
        return self.outcome


@pytest.fixture
def world():
    made = World()
    yield made
    made.holds.set([])
    made.holds.go_on()


def test_without_breakpoints_it_runs(world):
    world.begin()
    assert world.end() == "succeeded"
    assert world.runs == ["FIRST", "PLAIN", "LAST"]


def test_it_is_held_before_a_nested_state(world):
    world.begin("WORK/INNER/PLAIN")
    world.wait("WORK/INNER/PLAIN")
    assert world.runs == ["FIRST"]
    world.holds.go_on()
    assert world.end() == "succeeded"
    assert world.runs == ["FIRST", "PLAIN", "LAST"]


@pytest.mark.parametrize("path", ["WORK/FIRST", "WORK/INNER", "WORK/INNER/PLAIN", "WORK/LAST"])
def test_a_cancel_ends_the_hold_and_the_state_is_not_entered(world, path):
    world.begin(path)
    world.wait(path)
    before = list(world.runs)
    world.machine.cancel()
    assert world.end() == "preempted"
    assert world.runs == before
    assert world.holds.held == ""
    world.runs.clear()
    world.begin()  # nothing of the cancel is left
    assert world.end() == "succeeded"
    assert world.runs == ["FIRST", "PLAIN", "LAST"]


def test_a_step_ends_with_the_run(world):
    world.begin("WORK/LAST")
    world.wait("WORK/LAST")
    world.holds.set([])
    world.holds.step()
    assert world.end() == "succeeded"
    assert not world.holds.armed


def test_the_states_of_a_concurrence_are_held_each(world):
    both = smach.Concurrence(["succeeded"], "succeeded")
    runs = []
    with both:
        smach.Concurrence.add("ONE", Plain(runs, ["succeeded"]))
        smach.Concurrence.add("TWO", Plain(runs, ["succeeded"]))
    hook_states(both, "BOTH", Outcomes(world.holds))
    world.machine = MerlinSM(["succeeded"])
    with world.machine:
        world.machine.add("BOTH", both)
    world.begin("BOTH/ONE")
    world.wait("BOTH/ONE")
    world.holds.go_on()
    assert world.end() == "succeeded"
    assert runs == ["PLAIN", "PLAIN"]
