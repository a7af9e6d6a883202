# SPDX-License-Identifier: Apache-2.0
"""Plans that replace one another, whatever ends in whatever order: in one thread, with a clock of its own."""

import math
import queue
from itertools import count

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import (
    CancelRequest,
    DispatchEnvironment,
    DispatchLimits,
    Exchange,
    Feedback,
    FeedbackStatus,
    KnowledgeChanged,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule, SequentialSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm, TimedEffects
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_rosplan.rest.exchange import continued_graph, continued_list

PLAN_ID = 3
HANDS = ("left", "right", "third")


def operator(*needed):
    return ActionModel(
        "work",
        ("h", "x", "y"),
        at_start=Conditions(positive=(PlanTerm("free", ("h",)), *needed)),
        start_effects=TimedEffects(delete=(PlanTerm("free", ("h",)),)),
        end_effects=TimedEffects(add=(PlanTerm("free", ("h",)), PlanTerm("done", ("x",)))),
    )


#: The second needs what another action has done.
OPERATORS = {"work": operator(), "use": operator(PlanTerm("done", ("y",)))}


class Deadline:
    def __init__(self, world, seconds):
        self._world, self._end = world, world.time + (math.inf if seconds is None else seconds)

    def remaining(self):
        return max(0.0, self._end - self._world.time)


class Hands(DispatchEnvironment):
    """The world of a dispatch, its client, and the queue of its events."""

    def __init__(self, draw, left, graph):
        self.draw, self.left, self.graph, self.time = draw, left, graph, 0.0
        self.events, self.wrong = [], []
        self.facts = {PlanTerm("free", (hand,)) for hand in HANDS}
        self.running = {}  # action id -> action
        self.cancelled, self.sent = set(), []
        self.trouble = False  # something has failed or was cancelled, or a plan came late
        self.ends = False  # something was stopped that no exchange has dropped
        self.handled = None  # the wish that the dispatch has got last
        self.wishes = []  # with the plan of each
        self.waiting = None  # a plan that is made, and not asked for yet
        self.ids, self.things = count(), count()

    def must(self, holds, otherwise):
        """A dispatch survives an exception of its world; so what is wrong is noted."""
        if not holds:
            self.wrong.append(otherwise)

    # --- plans

    def plan(self, kept=(), begins_with=()):
        """A plan for the world as it is when some actions have ended, and its actions."""
        ready = {term.arguments[0]: 0.0 for term in self.facts if term.name == "free"}
        ready.update({dict(action.parameters)["h"]: 0.0 for action in kept})
        done = {term.arguments[0]: 0.0 for term in self.facts if term.name == "done"}
        done.update({dict(action.parameters)["x"]: 0.0 for action in kept})
        found = []

        def add(name, parameters, time):
            found.append(PlannedAction(next(self.ids), name, tuple(parameters), 1.0, time))
            ready[dict(parameters)["h"]] = done[dict(parameters)["x"]] = time + 1.1

        for action in begins_with:
            add(action.name, action.parameters, 0.0)
        for _ in range(self.draw(st.integers(0, 4)) if ready else 0):
            hand, thing = self.draw(st.sampled_from(sorted(ready))), f"o{next(self.things)}"
            needs = self.draw(st.sampled_from(["", *sorted(done)]))
            time = max(ready[hand], done.get(needs, 0.0))
            parameters = (("h", hand), ("x", thing), ("y", needs or thing))
            add("use" if needs else "work", parameters, time)
        return sorted(found, key=lambda action: (action.time, action.id))

    def schedule(self, plan, ongoing=None):
        if not self.graph:
            return SequentialSchedule(plan if ongoing is None else continued_list(plan, ongoing))
        steps = [
            PlanStep(each.time, each.name, tuple(value for _, value in each.parameters), each.duration)
            for each in plan
        ]
        graph = build_graph(steps, [self.operator(each) for each in plan])
        if ongoing is not None:
            plan = continued_graph(graph, plan, ongoing, self.operator)
        return GraphSchedule(graph, plan)

    def make_wish(self):
        running = [self.running[key] for key in sorted(self.running) if key not in self.cancelled]
        kept = [action for action in running if self.draw(st.booleans())]
        others = [action for action in running if action not in kept and self.draw(st.booleans())]
        others = others if self.graph else others[: not kept]
        plan = self.plan(kept, others)
        wish = Exchange(
            frozenset(action.id for action in kept), lambda ongoing: (self.schedule(plan, ongoing), None)
        )
        self.waiting = (wish, plan, {str(action) for action in others})

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
        if isinstance(event, Exchange):
            self.handled = event
        return event

    def happen(self, timeout):
        self.left -= 1
        kinds = ["succeed"] * 3 * bool(self.running)
        if self.left > 0:
            kinds += ["plan", "plan and ask"] + ["ask"] * (self.waiting is not None)
            kinds += ["fail"] * bool(self.running) + ["cancel"] + ["pause"] * (timeout is not None)
        if not kinds:
            self.must(timeout is not None, "the dispatch waits for what never comes")
            return
        kind = self.draw(st.sampled_from(kinds))
        if kind in ("succeed", "fail"):
            action = self.draw(st.sampled_from(sorted(self.running)))
            stopped = action in self.cancelled and self.draw(st.booleans())
            self.trouble |= kind == "fail" and action not in self.cancelled
            self.answer(action, kind == "succeed" and not stopped)
        if kind.startswith("plan"):
            self.make_wish()
        if kind.endswith("ask"):
            wish, *rest = self.waiting
            self.wishes.append((wish, *rest))
            self.waiting = None
            self.trouble |= kind == "ask"
            self.put(wish)
        elif kind == "cancel" and self.draw(st.booleans()):
            self.trouble = True
            self.put(CancelRequest("cancelled"))

    def answer(self, key, succeeded):
        action = self.running.pop(key)
        model = self.operator(action)
        self.facts |= set(model.end_effects.add if succeeded else model.start_effects.delete)
        self.put(KnowledgeChanged(frozenset({"free", "done"})))
        status = FeedbackStatus.SUCCEEDED if succeeded else FeedbackStatus.FAILED
        self.put(Feedback(key, int(status), PLAN_ID, "why"))

    # --- the environment

    def now(self):
        return self.time

    def deadline(self, seconds):
        return Deadline(self, seconds)

    def send(self, action):
        model = self.operator(action)
        self.must(action.id not in self.sent, "dispatched twice")
        self.must(set(model.at_start.positive) <= self.facts, "begun before its conditions hold")
        self.must(not self.ends, "a start after the end was decided")
        self.must(not self.cancelled & self.running.keys(), "a start before what is dropped has stopped")
        self.sent.append(action.id)
        self.running[action.id] = action
        self.facts -= set(model.start_effects.delete)
        self.put(Feedback(action.id, int(FeedbackStatus.ENABLED), PLAN_ID))

    def send_cancel(self, action):
        exchanges = self.handled is not None and not self.handled.ended.is_set()
        if exchanges:
            begins_with = next(rest for wish, _, rest in self.wishes if wish is self.handled)
            self.must(action.id not in self.handled.keep, "what goes on is cancelled")
            self.must(str(action) not in begins_with, "what the plan begins with is cancelled")
        self.ends |= not exchanges
        self.cancelled.add(action.id)

    def close(self, action):
        self.must(action.id == self.sent[-1], "the tombstone is of another action")

    def publish_feedback(self, action, status):
        pass

    def operator(self, action):
        return OPERATORS[action.name].ground(dict(action.parameters))

    def false_of(self, action, conditions):
        return Conditions(tuple(atom for atom in conditions.positive if atom not in self.facts))

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


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data(), st.integers(0, 30), st.booleans())
def test_each_action_is_dispatched_once_and_the_last_plan_is_reached_or_fails(data, changes, graph):
    world = Hands(data.draw, changes, graph)
    plan = world.plan()
    limits = DispatchLimits(accept=None, liveness=None, cancel=1e6)
    dispatch = PlanDispatch(world.schedule(plan), world, limits, PLAN_ID, world)
    report = dispatch.run()
    assert not world.wrong
    assert report.running == () and report.unanswered == () and not world.running
    assert all(wish.ended.is_set() for wish, _, _ in world.wishes)
    for wish, further, _ in world.wishes:
        plan = plan if wish.refusal else further
    if report.success:
        assert {PlanTerm("done", (dict(action.parameters)["x"],)) for action in plan} <= world.facts
    else:
        assert report.reason and world.trouble, report.reason
