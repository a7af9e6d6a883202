# SPDX-License-Identifier: Apache-2.0
"""A plan of several robots, whatever happens in whatever order: in one thread, with a clock of its own."""

import math
import queue

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import (
    CancelRequest,
    DispatchEnvironment,
    DispatchLimits,
    DispatchState,
    Feedback,
    FeedbackStatus,
    KnowledgeChanged,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm, TimedEffects
from merlin_rosplan.dispatch.plan_graph_builder import build_graph

PLAN_ID = 3
ROBOTS = ("ann", "bob", "carl")
WORK = ActionModel(
    "work",
    ("r", "x"),
    at_start=Conditions(positive=(PlanTerm("available", ("r",)), PlanTerm("free", ("r",)))),
    start_effects=TimedEffects(delete=(PlanTerm("free", ("r",)),)),
    end_effects=TimedEffects(add=(PlanTerm("free", ("r",)),)),
)


class Deadline:
    def __init__(self, robots, seconds):
        self._robots, self._end = robots, robots.time + (math.inf if seconds is None else seconds)

    def remaining(self):
        return max(0.0, self._end - self._robots.time)


class Robots(DispatchEnvironment):
    """The world of a dispatch and the queue of its events.

    Each look into the queue is a moment at which the world may change. After `left` changes it only answers,
    so that every plan ends.
    """

    def __init__(self, draw, left):
        self.draw, self.left, self.time = draw, left, 0.0
        self.events, self.wrong = [], []
        self.there = set(ROBOTS)
        self.running = {}  # action id -> robot
        self.robot_reported = self.stop_reported = False  # the events that the dispatch has got
        self.sent, self.cancelled, self.succeeded, self.ever_left = [], [], [], set()

    def must(self, holds, otherwise):
        """A dispatch survives an exception of its world; so what is wrong is noted."""
        if not holds:
            self.wrong.append(otherwise)

    # --- the queue

    def put(self, event):
        self.events.append(event)

    def get(self, timeout=None):
        if not self.events:
            self.happen(timeout)
        if not self.events:
            self.time += timeout
            raise queue.Empty
        return self.deliver()

    def get_nowait(self):
        if not self.events:
            raise queue.Empty
        return self.deliver()

    def deliver(self):
        event = self.events.pop(0)
        if isinstance(event, CancelRequest):
            self.stop_reported = True
        elif isinstance(event, Feedback) and event.status == FeedbackStatus.FAILED:
            self.robot_reported |= bool(event.robot)
            self.stop_reported |= not event.robot
        return event

    def happen(self, timeout):
        """One change of the world; with a timeout there may be none."""
        self.left -= 1
        kinds = ["succeed"] * 4 * bool(self.running)
        if self.left > 0:
            kinds += ["fail"] * bool(self.running) + ["leave", "leave", "return", "cancel"]
            kinds += ["pause"] if timeout is not None else []
        if not kinds:
            self.must(timeout is not None, "the dispatch waits for what never comes")
            return
        kind = self.draw(st.sampled_from(kinds))
        if kind in ("succeed", "fail"):
            action = self.draw(st.sampled_from(sorted(self.running)))
            failed = kind == "fail" or action in self.cancelled
            self.answer(action, FeedbackStatus.FAILED if failed else FeedbackStatus.SUCCEEDED)
        elif kind == "leave":
            self.leave(self.draw(st.sampled_from(ROBOTS)))
        elif kind == "return":
            self.there |= {self.draw(st.sampled_from(ROBOTS))}
            self.put(KnowledgeChanged(frozenset({"available"})))
        elif kind == "cancel" and self.draw(st.booleans()):
            self.put(CancelRequest("cancelled"))

    def leave(self, robot):
        self.there.discard(robot)
        self.ever_left.add(robot)
        self.put(KnowledgeChanged(frozenset({"available"})))
        for action in [action for action, its in self.running.items() if its == robot]:
            self.answer(action, FeedbackStatus.FAILED, robot)

    def answer(self, action, status, robot=""):
        del self.running[action]
        if status == FeedbackStatus.SUCCEEDED:
            self.succeeded.append(action)
        self.put(KnowledgeChanged(frozenset({"free"})))
        self.put(Feedback(action, int(status), PLAN_ID, "why", robot))

    # --- the environment

    def now(self):
        return self.time

    def deadline(self, seconds):
        return Deadline(self, seconds)

    def send(self, action):
        robot = dict(action.parameters)["r"]
        self.must(action.id not in self.sent, "dispatched twice")
        self.must(robot not in self.running.values(), "two actions on one robot")
        self.must(robot in self.there, "an action for a robot that has left")
        self.must(not self.robot_reported and not self.stop_reported, "a start after the end was decided")
        self.sent.append(action.id)
        self.running[action.id] = robot
        self.put(Feedback(action.id, int(FeedbackStatus.ENABLED), PLAN_ID))

    def send_cancel(self, action):
        self.must(self.stop_reported, "only a cancel and a failure stop what runs, not a robot that leaves")
        self.cancelled.append(action.id)

    def close(self, action):
        self.must(action.id == self.sent[-1], "the tombstone is of another action")

    def publish_feedback(self, action, status):
        pass

    def operator(self, action):
        return WORK.ground(dict(action.parameters))

    def false_of(self, action, conditions):
        busy = set(self.running.values())
        true = {PlanTerm("available", (robot,)) for robot in self.there}
        true |= {PlanTerm("free", (robot,)) for robot in ROBOTS if robot not in busy}
        return Conditions(tuple(atom for atom in conditions.positive if atom not in true))

    def robot_left(self, action, unmet):
        return next((atom.arguments[0] for atom in unmet.positive if atom.name == "available"), "")

    def begun(self, action):
        return True

    def seconds_silent(self, operator):
        return 0.0

    def just_announced(self, operator):
        return False

    def wake_at(self, when):
        pass

    def changed(self, report):
        pass


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data(), st.lists(st.sampled_from(ROBOTS), min_size=1, max_size=8), st.integers(0, 25))
def test_a_robot_that_leaves_stops_its_own_actions_only(data, robots, changes):
    count = dict.fromkeys(ROBOTS, 0)
    steps, actions = [], []
    for number, robot in enumerate(robots):
        steps.append(PlanStep(2.0 * count[robot], "work", (robot, f"o{number}"), 1.0))
        parameters = (("r", robot), ("x", f"o{number}"))
        actions.append(PlannedAction(number, "work", parameters, 1.0, steps[-1].time))
        count[robot] += 1
    graph = build_graph(steps, [WORK.ground(dict(action.parameters)) for action in actions])
    world = Robots(data.draw, changes)
    limits = DispatchLimits(accept=None, liveness=None, cancel=1e6)
    dispatch = PlanDispatch(GraphSchedule(graph, actions), world, limits, PLAN_ID, world)
    report = dispatch.run()
    assert not world.wrong
    assert report.running == () and report.unanswered == () and not world.running
    assert report.success == (len(world.succeeded) == len(actions))
    assert bool(world.cancelled) <= world.stop_reported
    if report.success:
        return
    if not world.stop_reported:
        failed = dict(report.failed_action.parameters)["r"]
        assert report.state is DispatchState.FAILED and failed in world.ever_left
