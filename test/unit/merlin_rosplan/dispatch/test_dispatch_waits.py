# SPDX-License-Identifier: Apache-2.0
"""What an action waits for before it starts: start effects of others, and what comes true at a time."""

import pytest
from dispatch_world import GUARDED, LIGHT, WORK, Run, World, actions, parallel

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchState,
    FeedbackStatus,
    KnowledgeChanged,
    Tick,
)
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm, TimedEffects
from merlin_rosplan.dispatch.plan_graph import TimedLiteral
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_test import LONG


@pytest.fixture
def world():
    return World(WORK, GUARDED, LIGHT)


def test_a_parallel_action_waits_for_the_start_effects_it_builds_on(world):
    world.facts = {PlanTerm("safe", ("o1",))}
    run = Run(world, parallel(["work", "guarded"]), settle=LONG)
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    world.wait_answers(2)
    assert set(world.wakes) <= {None}  # waits for the change, no time is asked for
    world.facts = {
        PlanTerm("safe", ("o1",)),
        PlanTerm("free", ("o1",)),
    }  # what the interface of work has applied
    run.dispatch.put(KnowledgeChanged())
    world.wait("action", 1)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_parallel_action_whose_condition_stays_false_is_refused(world):
    run = Run(world, parallel(["work", "guarded"]), settle=0.05, cancel=0.05)
    world.wait("action", 0)
    report = run.report()
    assert report.state == DispatchState.FAILED and "(guarded o1) cannot start" in report.reason


OPEN = ActionModel(
    "open", ("x",), start_effects=TimedEffects(add=(PlanTerm("free", ("o1",)),)), durative=False
)


def opened_and_guarded(world):
    """The run of ROSPlan's graph, which has the effects of a plain action at its start."""
    world.operators["open"] = OPEN
    steps = [PlanStep(float(i), name, (f"o{i}",), 1.0) for i, name in enumerate(["open", "guarded"])]
    ground = [OPEN, GUARDED.ground({"x": "o1"})]
    schedule = GraphSchedule(build_graph(steps, ground, as_rosplan=True), actions("open", "guarded"))
    world.facts = {PlanTerm("safe", ("o1",))}
    return Run(world, schedule, settle=0.0)


def test_an_action_waits_for_a_plain_one_whose_effects_come_at_its_end(world):
    run = opened_and_guarded(world)
    world.wait_answers(2)
    world.facts |= {PlanTerm("free", ("o1",))}
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_plain_action_that_ends_without_what_it_promised_is_waited_for_no_longer(world):
    run = opened_and_guarded(world)
    world.wait_answers(2)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    report = run.report()
    assert report.state == DispatchState.FAILED and "(guarded o1) cannot start" in report.reason


def after_a_timed_literal():
    """A plan of one guarded action whose `free` comes true 1 ms after the start."""
    graph = build_graph(
        [PlanStep(0.01, "guarded", ("o0",), 1.0)],
        [GUARDED.ground({"x": "o0"})],
        [TimedLiteral(0.001 + 1e-4, PlanTerm("free", ("o0",)))],
    )
    return GraphSchedule(graph, actions("guarded"))


def started(world, run):
    """Waits until the time of the literal has come, as an alarm would say, and the action was tried."""
    while not world.answers:
        run.dispatch.put(Tick())
        with world.changed_event:
            world.changed_event.wait(0.005)


def test_a_timed_literal_that_the_knowledge_base_applies_a_little_later_is_waited_for(world):
    world.facts = {PlanTerm("safe", ("o0",))}
    run = Run(world, after_a_timed_literal(), settle=LONG)
    started(world, run)
    world.facts = {PlanTerm("safe", ("o0",)), PlanTerm("free", ("o0",))}
    run.dispatch.put(KnowledgeChanged())
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_timed_literal_that_does_not_come_is_named(world):
    world.facts = {PlanTerm("safe", ("o0",))}
    run = Run(world, after_a_timed_literal(), settle=0.05)
    started(world, run)
    report = run.report()
    assert report.state == DispatchState.FAILED and "(free o0) does not hold" in report.reason


BURNING = PlanTerm("burning", ("o0",))
READ = ActionModel("read", ("x",), at_start=Conditions(positive=(BURNING,)))


def lit_and_read(world, **limits):
    """A plan that reads by a light, over a knowledge base that does not list what has begun."""
    world.operators["read"] = READ
    steps = [PlanStep(0.1 * i, name, (f"o{i}",), 1.0 - 0.8 * i) for i, name in enumerate(["light", "read"])]
    graph = build_graph(steps, [LIGHT.ground({"x": "o0"}), READ])
    return Run(world, GraphSchedule(graph, actions("light", "read")), **limits)


def test_a_change_of_what_a_start_changes_lets_the_next_action_start(world):
    world.facts = {BURNING}  # of before
    run = lit_and_read(world)
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.dispatch.put(KnowledgeChanged(frozenset({"safe"})))
    turns = len(world.wakes) + 2  # the first may have begun before these events
    while len(world.wakes) < turns:
        run.dispatch.put(Tick())
        with world.changed_event:
            world.changed_event.wait(0.005)
    assert ("action", 1) not in world.published
    run.dispatch.put(KnowledgeChanged(frozenset({"burning"})))
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_start_that_changes_nothing_keeps_the_next_action_no_longer_than_it_may_take(world):
    world.facts = {BURNING}
    run = lit_and_read(world, settle=0.05)
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success
