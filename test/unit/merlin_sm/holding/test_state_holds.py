# SPDX-License-Identifier: Apache-2.0
"""Machines are held before states: breakpoints, step, continue, preempt, and the end without a console."""

import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_pddl.breakpoints import MOST, BreakpointError
from merlin_sm.holding.state_holds import GRACE, Machine, StateHolds, names_state, read_state_pattern
from merlin_test import LONG

PATHS = ["NAVIGATE/DRIVE", "NAVIGATE/SAY", "ASK/SPEAK/SAY"]


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Run(threading.Thread):
    """Enters states one after the other, as a machine does."""

    def __init__(self, holds, paths, preempted=lambda: False):
        super().__init__(daemon=True)
        self.holds, self.paths, self.preempted = holds, paths, preempted
        self.machine, self.state = Machine(), object()
        self.entered = []
        self.start()

    def run(self):
        for path in self.paths:
            if self.holds.armed:
                self.holds.wait(self.machine, self.state, path, self.preempted)
            self.entered.append(path)
        self.holds.end_step(self.machine)

    def end(self):
        self.join(LONG)
        assert not self.is_alive()
        return self.entered


class Reported:
    """Waits until a state is held."""

    def __init__(self, holds):
        self.holds, self.changed = holds, threading.Condition()
        holds.on_change = self

    def __call__(self):
        with self.changed:
            self.changed.notify_all()

    def wait(self, *paths):
        with self.changed:
            assert self.changed.wait_for(lambda: self.holds.waiting == list(paths), LONG), self.holds.waiting


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def holds(clock):
    made = StateHolds(clock)
    made.declare("NAVIGATE", PATHS[:2])
    made.declare("ASK", PATHS[2:])
    return made


@pytest.mark.parametrize("text", ["NAVIGATE", "NAVIGATE/", "//", "(a/b)", "a/b(", f"a/{'b' * 400}"])
def test_what_is_no_state_is_refused(holds, text):
    holds.set(["NAVIGATE/DRIVE"])
    with pytest.raises(BreakpointError, match="is not a state"):
        holds.set([text])
    assert holds.texts == ["NAVIGATE/DRIVE"]


def test_states_are_reported_from_actions_and_goals():
    assert names_state("NAVIGATE/DRIVE")
    assert not any(map(names_state, ("(navigate a b)", "navigate", "(at a/b)")))
    assert read_state_pattern("/navigate/Drive") == ("NAVIGATE", "DRIVE")


def test_too_many_are_refused(holds):
    with pytest.raises(BreakpointError, match=str(MOST)):
        holds.set([f"NAVIGATE/S{number}" for number in range(MOST + 1)])


def test_only_states_that_exist_are_kept(holds):
    holds.set(["navigate/drive", "NAVIGATE/FLY", "ASK/*", "ASK/*/SAY"])
    assert holds.texts == ["navigate/drive", "ASK/*/SAY"]
    holds.set([])
    assert not holds.armed


def test_it_is_held_steps_and_goes_on(holds):
    reported = Reported(holds)
    holds.set(["NAVIGATE/DRIVE"])
    run = Run(holds, [*PATHS[:2], *PATHS[:2]])
    reported.wait("NAVIGATE/DRIVE")
    assert (run.entered, holds.held) == ([], "NAVIGATE/DRIVE")
    holds.step()
    reported.wait("NAVIGATE/SAY")
    assert run.entered == PATHS[:1]
    holds.go_on()
    reported.wait("NAVIGATE/DRIVE")
    assert run.entered == PATHS[:2]
    holds.set([])
    assert holds.waiting == ["NAVIGATE/DRIVE"]  # what is held stays so
    holds.go_on()
    assert run.end() == [*PATHS[:2], *PATHS[:2]]
    assert not holds.armed and holds.held == ""


def test_a_step_holds_its_own_machine_only_and_ends_with_its_run(holds):
    reported = Reported(holds)
    holds.set(["NAVIGATE/SAY"])
    run = Run(holds, PATHS[:2])
    reported.wait("NAVIGATE/SAY")
    holds.set([])
    holds.step()
    run.end()
    assert not holds.armed
    assert Run(holds, PATHS).end() == PATHS


def test_a_preempt_ends_the_hold_of_its_state_alone(holds):
    reported = Reported(holds)
    holds.set(["NAVIGATE/DRIVE", "ASK/SPEAK/SAY"])
    first = Run(holds, PATHS[:1])
    reported.wait("NAVIGATE/DRIVE")
    second = Run(holds, PATHS[2:])
    reported.wait("NAVIGATE/DRIVE", "ASK/SPEAK/SAY")
    holds.release(first.state)
    assert first.end() == PATHS[:1]
    assert holds.waiting == ["ASK/SPEAK/SAY"]
    holds.go_on()
    second.end()


def test_one_that_is_preempted_already_is_not_held(holds):
    holds.set(["NAVIGATE/*"])
    assert Run(holds, PATHS[:2], lambda: True).end() == PATHS[:2]


def test_without_a_console_it_goes_on_by_itself(holds, clock):
    said = []
    reported = Reported(holds)
    holds.on_lost = said.append
    holds.set(["NAVIGATE/*"])
    run = Run(holds, PATHS[:2])
    reported.wait("NAVIGATE/DRIVE")
    clock.now += GRACE - 1
    holds.followed()
    clock.now += GRACE  # of the console's last word
    reported.wait("NAVIGATE/DRIVE")
    assert run.entered == []
    clock.now += 1
    assert run.end() == PATHS[:2]  # noticed at the next heartbeat
    assert holds.texts == [] and not holds.armed
    assert len(said) == 1 and "no console" in said[0]


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.sampled_from(PATHS), max_size=6),
    st.lists(st.sampled_from(["NAVIGATE/*", "ASK/SPEAK/SAY", "*/DRIVE"]), max_size=3),
    st.lists(st.sampled_from(["step", "go_on", "preempt"]), min_size=1, max_size=4),
)
def test_whatever_is_asked_for_each_state_is_entered_once_and_nothing_is_left(paths, points, orders):
    holds = StateHolds(Clock())
    holds.declare("ALL", PATHS)
    reported = Reported(holds)
    holds.set(points)
    run = Run(holds, paths)
    number = 0
    while run.is_alive():
        with reported.changed:
            reported.changed.wait_for(lambda: holds.waiting or not run.is_alive(), 0.01)
        if holds.waiting:
            order = orders[number % len(orders)]
            number += 1
            holds.release(run.state) if order == "preempt" else getattr(holds, order)()
    assert run.end() == paths
    assert holds.held == ""
    assert holds.armed == bool(holds.texts)
