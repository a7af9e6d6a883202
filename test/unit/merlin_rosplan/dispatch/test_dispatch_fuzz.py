# SPDX-License-Identifier: Apache-2.0
"""Dispatches under whatever may arrive in whatever order, and readers under whatever text."""

import random
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosplan_dispatch_msgs.msg import ActionDispatch, EsterelPlan, EsterelPlanEdge, EsterelPlanNode

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchEnvironment,
    DispatchError,
    DispatchLimits,
    DispatchState,
    Feedback,
    KnowledgeChanged,
    Tick,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule, SequentialSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlanError, PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_rosplan.messages.plan_graph_messages import graph_from_message, graph_to_dot
from merlin_rosplan.planning.planner_command import PlannerCommandError, parse_command
from merlin_rosplan.planning.planner_output import candidate_plans, verdict
from merlin_test import LONG

PLAN_ID = 5
STATUSES = (0, 1, 1, 1, 2, 2, 2, 3, 4, 10, 77, -1)


class NoDeadline:
    def remaining(self):
        return float("inf")


class Chaos(DispatchEnvironment):
    """A world that throws random events at a dispatch whenever it is touched."""

    def __init__(self, rng):
        self.rng = rng
        self.dispatch = None
        self.sent, self.cancelled, self.stones = [], [], []
        self.answered = set()
        self.left = 400

    def noise(self):
        """Nonsense, the truth now and then, and after enough of it only the truth, so that it ends."""
        if self.dispatch is None:
            return
        for _ in range(self.rng.randrange(3)):
            self.left -= 1
            kind = self.rng.randrange(12)
            if kind == 0:
                self.dispatch.put(KnowledgeChanged())
            elif kind == 1:
                self.dispatch.put(Tick())
            elif kind == 2 and self.rng.random() < 0.1:
                self.dispatch.cancel()
            else:
                action = self.rng.randrange(-2, 12)
                plan_id = self.rng.choice((PLAN_ID, PLAN_ID, 0, PLAN_ID - 1))
                self.dispatch.put(Feedback(action, self.rng.choice(STATUSES), plan_id))

    def now(self):
        return 0.0

    def deadline(self, seconds):
        return NoDeadline()

    def send(self, action):
        assert action.id not in self.sent, "dispatched twice"
        self.sent.append(action.id)
        self.noise()
        self.dispatch.put(Feedback(action.id, 1, PLAN_ID))
        self.noise()
        self.dispatch.put(Feedback(action.id, 2 if self.rng.random() < 0.9 else 10, PLAN_ID))

    def send_cancel(self, action):
        assert action.id in self.sent and action.id not in self.cancelled
        self.cancelled.append(action.id)
        self.noise()
        self.dispatch.put(Feedback(action.id, 10, PLAN_ID, "cancelled"))

    def close(self, action):
        self.stones.append(action.id)

    def publish_feedback(self, action, status):
        self.noise()

    def operator(self, action):
        if self.rng.random() < 0.01:
            raise DispatchError("no answer")
        return ActionModel(action.name, ())

    def false_of(self, action, conditions):
        self.noise()
        return Conditions()

    def seconds_silent(self, operator):
        return None

    def just_announced(self, operator):
        return False

    def wake_at(self, when):
        pass

    def changed(self, report):
        self.noise()


def schedule(rng):
    count = rng.randrange(0, 10)
    actions = [PlannedAction(index, "work") for index in range(count)]
    if rng.random() < 0.5:
        return SequentialSchedule(actions)
    steps = [PlanStep(float(rng.randrange(5)), "work", ()) for _ in range(count)]
    graph = build_graph(steps, [ActionModel("work", ())] * count)
    return GraphSchedule(graph, actions)


@pytest.mark.parametrize("block", range(10))
def test_every_dispatch_ends_and_leaves_nothing_running(block):
    for seed in range(block * 100, block * 100 + 100):
        rng = random.Random(seed)
        world = Chaos(rng)
        plan = schedule(rng)
        world.dispatch = dispatch = PlanDispatch(plan, world, DispatchLimits(cancel=None), PLAN_ID)
        reports = []
        thread = threading.Thread(target=lambda d=dispatch, r=reports: r.append(d.run()), daemon=True)
        thread.start()
        thread.join(LONG)
        assert reports, f"seed {seed} does not end"
        report = reports[0]
        assert report.running == () and report.unanswered == ()
        assert len(world.stones) == (1 if world.sent else 0), f"seed {seed}"
        assert not world.sent or world.stones == world.sent[-1:]
        assert report.steps_done <= len(world.sent)
        assert report.success == (report.state == DispatchState.SUCCEEDED)
        assert not report.success or report.steps_done == report.steps_total == len(plan.actions)
        assert report.reason


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=400), st.text(max_size=100), st.integers(-40, 260))
def test_any_output_of_a_planner_is_read(output, errors, code):
    for plan in candidate_plans(output, [("sas_plan", errors), ("plan.SOL", output)]):
        for step in plan:
            assert step.name
    said = verdict(output, errors, code, "fast-downward")
    assert said is None or said.reason


PIECES = [
    "ff: found legal plan as follows\n",
    "step    0: A B\n",
    "0.0: (a b) [1.0]\n",
    "; Time 0.1\n",
    ";;;; Solution Found\n",
    "Actual search time: 0\n",
    "a b (1)\n",
    "Plan length: 1\n",
    '{"temporal":true,"steps":[{"time":0,"duration":1,"action":"(a)"}]}\n',
    '{"temporal":true,"steps":[{"time":{}}]}\n',
    '{"temporal":true,"steps":[{"time":0,"duration":1,"action":"()"}]}\n',
    "; cost = 3\n",
    "(a b)\n",
    "\n",
    "0.0: () [1.0]\n",
    "[t=0s, 9 KB] ",
]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.sampled_from(PIECES), max_size=20).map("".join))
def test_any_mixture_of_planner_lines_is_read(output):
    for plan in candidate_plans(output):
        for step in plan:
            assert step.name and step.duration >= 0


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet="timeout 0123456789.smh-kPROBLEMDOMAIN'\"=$/ab \n", max_size=60))
def test_any_command_is_taken_apart_or_refused(text):
    try:
        command = parse_command(text)
    except PlannerCommandError:
        return
    assert command.program and command.name is not None


@settings(max_examples=150, deadline=None)
@given(
    st.lists(st.tuples(st.integers(-1, 3), st.integers(0, 5), st.integers(0, 4)), max_size=6),
    st.lists(st.tuples(st.integers(-1, 4), st.integers(0, 6), st.integers(0, 6)), max_size=8),
)
def test_any_graph_message_is_run_or_refused(nodes, edges):
    message = EsterelPlan(
        nodes=[
            EsterelPlanNode(node_type=kind, node_id=number, action=ActionDispatch(action_id=action, name="a"))
            for kind, number, action in nodes
        ],
        edges=[EsterelPlanEdge(edge_type=kind, source_ids=[a], sink_ids=[b]) for kind, a, b in edges],
    )
    try:
        graph, actions = graph_from_message(message)
        plan = GraphSchedule(graph, [PlannedAction(action.action_id, action.name) for action in actions])
    except PlanError as error:
        assert str(error)
        return
    assert graph_to_dot(graph, actions, plan.node_state, lambda _: False).startswith("digraph")
    plan.begin(0.0)
    for _ in range(20):
        ready = plan.ready(0.0)
        for action in ready:
            plan.started(action.id, 0.0)
            plan.ended(action.id, 0.0)
    assert plan.finished or plan.waiting() or not plan.ready(0.0)
