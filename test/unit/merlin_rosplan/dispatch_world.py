# SPDX-License-Identifier: Apache-2.0
"""A world that a test controls, and dispatches in it."""

import threading
import time
from dataclasses import replace
from itertools import zip_longest

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchEnvironment,
    DispatchError,
    DispatchLimits,
    Feedback,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm, TimedEffects
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_test import LONG

PLAN_ID = 7
#: A test may stand still for seconds; one that waits for the end of a patience names its own.
PATIENT = dict.fromkeys(("acknowledge", "accept", "liveness", "cancel", "over_all_grace", "settle"), LONG)


class TestDeadline:
    __test__ = False

    def __init__(self, seconds):
        self._end = float("inf") if seconds is None else time.monotonic() + seconds

    def remaining(self):
        return max(0.0, self._end - time.monotonic())


class World(DispatchEnvironment):
    """Facts that hold, operators by name, and a record of everything that was published."""

    def __init__(self, *operators):
        self.operators = {operator.name: operator for operator in operators}
        self.facts = set()
        self.published = []
        self.reports = []
        self.answers = []
        self.silences = {}
        self.left = set()  # ids of actions whose interface has closed its connection
        self.just_announced_operators = set()
        self.robot_of = lambda action, unmet: ""
        self.changed_event = threading.Condition()
        self.on_send = lambda action: None
        self.broken = False
        self.wakes = []

    def note(self, kind, action):
        with self.changed_event:
            self.published.append((kind, action.id))
            self.changed_event.notify_all()

    def wait(self, *entry):
        with self.changed_event:
            assert self.changed_event.wait_for(lambda: entry in self.published, LONG), self.published

    def now(self):
        return time.monotonic()

    def deadline(self, seconds):
        return TestDeadline(seconds)

    def send(self, action):
        self.note("action", action)
        self.on_send(action)

    def send_cancel(self, action):
        self.note("cancel", action)

    def close(self, action):
        self.note("tombstone", action)

    def publish_feedback(self, action, status):
        self.note(f"own {int(status)}", action)

    def operator(self, action):
        operator = self.operators[action.name]
        return operator.ground(operator.bind([value for _, value in action.parameters], action.duration))

    def false_of(self, action, conditions):
        if self.broken:
            raise DispatchError("the knowledge base does not answer")
        answer = Conditions(
            tuple(atom for atom in conditions.positive if atom not in self.facts),
            tuple(atom for atom in conditions.negative if atom in self.facts),
        )
        with self.changed_event:
            self.answers.append(answer)
            self.changed_event.notify_all()
        return answer

    def wait_answers(self, count):
        with self.changed_event:
            assert self.changed_event.wait_for(lambda: len(self.answers) >= count, LONG)

    def robot_left(self, action, unmet):
        return self.robot_of(action, unmet)

    def seconds_silent(self, operator):
        return self.silences.get(operator)

    def has_left(self, action):
        return action.id in self.left

    def just_announced(self, operator):
        return operator in self.just_announced_operators

    def wake_at(self, when):
        self.wakes.append(when)

    def changed(self, report):
        with self.changed_event:
            self.reports.append(report)
            self.changed_event.notify_all()


WORK = ActionModel("work", ("x",))
GUARDED = ActionModel(
    "guarded",
    ("x",),
    at_start=Conditions(positive=(PlanTerm("free", ("x",)),), negative=(PlanTerm("blocked", ("x",)),)),
    over_all=Conditions(positive=(PlanTerm("safe", ("x",)),)),
)
#: makes its own over-all condition true at its start and false at its end
LIGHT = ActionModel(
    "light",
    ("x",),
    over_all=Conditions(positive=(PlanTerm("burning", ("x",)),)),
    start_effects=TimedEffects(add=(PlanTerm("burning", ("x",)),)),
    end_effects=TimedEffects(delete=(PlanTerm("burning", ("x",)),)),
)


def actions(*names):
    return [PlannedAction(i, name, (("x", f"o{i}"),), 1.0, float(i)) for i, name in enumerate(names)]


class Run:
    """A dispatch in a thread of its own."""

    def __init__(self, world, schedule, **limits):
        self.dispatch = PlanDispatch(schedule, world, DispatchLimits(**{**PATIENT, **limits}), PLAN_ID)
        self._report = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        self._report = self.dispatch.run()

    def feedback(self, action_id, status, plan_id=PLAN_ID, reason="", robot="", unstopped=False):
        self.dispatch.put(Feedback(action_id, int(status), plan_id, reason, robot, unstopped))

    def report(self):
        self._thread.join(LONG)
        assert not self._thread.is_alive(), "the dispatch does not end"
        return self._report


def parallel(names, durations=()):
    timed = zip_longest(actions(*names), durations, fillvalue=1.0)
    planned = [replace(action, duration=seconds) for action, seconds in timed]
    steps = [PlanStep(0.0, name, (f"o{i}",), 1.0) for i, name in enumerate(names)]
    return GraphSchedule(
        build_graph(steps, [WORK.ground({"x": f"o{i}"}) for i, _ in enumerate(names)]), planned
    )
