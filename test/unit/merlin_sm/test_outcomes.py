"""Operators decide with which outcomes states are left: forced ones, autonomy levels; a cancel wins."""

import threading

import pytest

import smach
from merlin_pddl.breakpoints import BreakpointError
from merlin_sm.holding.gate import gate
from merlin_sm.holding.outcomes import NoSuchState, Outcomes
from merlin_sm.holding.state_holds import GRACE, StateHolds
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import MerlinState

LONG = 60.0


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


class Work(MerlinState):
    """Runs until it is let end, or is preempted; it stops when the test lets it."""

    def __init__(self, runs):
        super().__init__(["nothing"], output_keys=["found"])
        self.runs, self.ends = runs, "succeeded"
        self.runs_now, self.go, self.stopping, self.stop = (threading.Event() for _ in range(4))
        self.stop.set()

    def run(self, userdata):
        self.runs.append("WORK")
        self.runs_now.set()
        self.interruptible(self.go.set)
        assert self.go.wait(LONG)
        self.interruptible(None)
        if not self.preempt_requested():
            return self.ends
        self.stopping.set()
        assert self.stop.wait(LONG)
        if self.unstopped:
            return self.fail("it did not stop")
        return "preempted"


class Noted(FunctionState):
    """Notes that it ran."""

    def __init__(self, label, runs):
        super().__init__(self.note)
        self.label, self.runs, self.calls = label, runs, []

    def note(self, userdata):
        self.runs.append(self.label)
        for call in self.calls:
            call()

    def register(self, call):
        self.calls.append(call)


class World:
    """FIRST, then WORK, then SEE (succeeded), LOOK (nothing) or the end."""

    def __init__(self, **autonomy):
        self.runs, self.left, self.outcome = [], [], None
        self.holds = StateHolds(Clock())
        self.changed = threading.Condition()
        self.holds.on_change = self.notify
        self.outcomes = Outcomes(self.holds)
        self.outcomes.on_left = self.left.append
        self.machine = MerlinSM(["succeeded", "aborted", "preempted"])
        self.work = Work(self.runs)
        with self.machine:
            self.machine.add("FIRST", self.note("FIRST"), {"succeeded": "WORK"})
            targets = {"succeeded": "SEE", "nothing": "LOOK"}
            self.machine.add("WORK", self.work, targets, autonomy=autonomy)
            self.see = self.machine.add("SEE", Noted("SEE", self.runs))
            self.machine.add("LOOK", self.note("LOOK"))
        gate(self.machine, "DO", self.outcomes)

    def notify(self):
        with self.changed:
            self.changed.notify_all()

    def note(self, label):
        return FunctionState(lambda userdata: self.runs.append(label))

    def begin(self):
        self.machine.prepare()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        try:
            self.outcome = self.machine.execute(smach.UserData())
        except smach.SmachError as error:
            self.outcome = error

    def wait(self, waits):
        with self.changed:
            assert self.changed.wait_for(waits, LONG)

    def wait_unconfirmed(self, *outcomes):
        self.wait(lambda: self.holds.unconfirmed == [("DO/WORK", outcome) for outcome in outcomes])

    def end(self):
        self.thread.join(LONG)
        assert not self.thread.is_alive()
        return self.outcome


@pytest.fixture
def world():
    made = World()
    yield made
    made.machine.cancel()
    made.work.stop.set()


@pytest.fixture
def high():
    """Its outcome `succeeded` requires the level `high`, `nothing` requires `full`."""
    made = World(succeeded="high", nothing="full")
    made.outcomes.set_level("low")
    yield made
    made.machine.cancel()


# --- forced outcomes ---------------------------------------------------------------------------------------


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
    assert "is no state" in why("DO", "succeeded")
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
    gate(other.machine, "DO", world.outcomes)
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
    gate(outer, "OUTER", outcomes)
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


# --- autonomy levels ---------------------------------------------------------------------------------------


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
    with pytest.raises(ValueError, match="'medium' is no autonomy level; there are off, low, high, full"):
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
    high.holds._clock.now += GRACE - 1
    high.holds.followed()
    high.holds._clock.now += GRACE
    assert high.holds.unconfirmed == [("DO/WORK", "succeeded")]
    high.holds._clock.now += 1
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
        with pytest.raises(ValueError, match="'higher' is no autonomy level"):
            machine.add_auto("GO", Work([]), ["succeeded"], autonomy={"succeeded": "higher"})
        machine.add("GO", Work([]), {"nothing": "succeeded"}, autonomy={"succeeded": "high"})
    outcomes = Outcomes(StateHolds())
    assert outcomes.level == ""
    gate(machine, "DO", outcomes)
    assert outcomes.level == "full"
