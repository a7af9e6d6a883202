# SPDX-License-Identifier: Apache-2.0
"""A machine whose states run until a test lets them end, and the outcomes that operators decide."""

import threading

import smach
from merlin_sm.holding.outcomes import Outcomes
from merlin_sm.holding.state_holds import StateHolds
from merlin_sm.holding.state_hook import hook_states
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import MerlinState
from merlin_test import LONG


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
        self.clock = Clock()
        self.holds = StateHolds(self.clock)
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
        hook_states(self.machine, "DO", self.outcomes)

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
