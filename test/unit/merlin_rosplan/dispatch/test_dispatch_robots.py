# SPDX-License-Identifier: Apache-2.0
"""A robot leaves while a plan is dispatched: the others finish what they do, and nothing else starts."""

import pytest
from dispatch_world import GUARDED, WORK, Run, World, actions, parallel

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.dispatch.dispatch_environment import DispatchState, FeedbackStatus
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule, SequentialSchedule
from merlin_rosplan.dispatch.operator_model import PlanTerm
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_test import LONG


@pytest.fixture
def world():
    return World(WORK)


@pytest.mark.parametrize("end", [FeedbackStatus.SUCCEEDED, FeedbackStatus.FAILED])
def test_when_a_robot_leaves_the_actions_of_the_others_go_on_and_nothing_starts(world, end):
    run = Run(world, parallel(["work", "work", "work"]))
    for action_id in range(3):
        world.wait("action", action_id)
    run.feedback(0, FeedbackStatus.FAILED, reason="robot ann is gone", robot="ann")
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: any(each.steps_done == 1 for each in world.reports), LONG)
    assert ("cancel", 2) not in world.published and not run.dispatch.ended.is_set()
    run.feedback(2, end, robot="" if end is FeedbackStatus.SUCCEEDED else "bob")
    report = run.report()
    assert report.state == DispatchState.FAILED and report.failed_action.id == 0
    assert "robot ann is gone" in report.reason and ("cancel", 2) not in world.published


def test_nothing_is_started_when_a_robot_has_left(world):
    run = Run(world, SequentialSchedule(actions("work", "work")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.FAILED, reason="robot ann is gone", robot="ann")
    assert run.report().state == DispatchState.FAILED
    assert ("action", 1) not in world.published


@pytest.mark.parametrize("failed", [False, True])
def test_what_goes_on_without_a_robot_is_stopped_by_a_cancel_and_by_a_failure(world, failed):
    run = Run(world, parallel(["work", "work", "work"]))
    for action_id in range(3):
        world.wait("action", action_id)
    run.feedback(0, FeedbackStatus.FAILED, reason="robot ann is gone", robot="ann")
    if failed:
        run.feedback(1, FeedbackStatus.FAILED, reason="broken")
    else:
        run.dispatch.cancel()
        run.feedback(1, FeedbackStatus.FAILED, reason="cancelled")
    world.wait("cancel", 2)
    run.feedback(2, FeedbackStatus.FAILED, reason="cancelled")
    assert run.report().state == (DispatchState.FAILED if failed else DispatchState.CANCELLED)


def test_a_robot_that_left_while_it_was_idle_stops_nothing_but_its_own_action(world):
    world.operators["guarded"] = GUARDED
    world.facts |= {PlanTerm("safe", ("o1",))}
    world.robot_of = lambda action, unmet: "ann" if unmet.positive else ""
    steps = [PlanStep(0.0, "work", ("o0",), 1.0), PlanStep(0.0, "guarded", ("o1",), 1.0)]
    models = [WORK.ground({"x": "o0"}), GUARDED.ground({"x": "o1"})]
    schedule = GraphSchedule(build_graph(steps, models), actions("work", "guarded"))
    run = Run(world, schedule, settle=0.0)
    world.wait("action", 0)
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: ("own 0", 1) in world.published, LONG)
    assert not run.dispatch.ended.is_set()
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    report = run.report()
    assert report.state == DispatchState.FAILED and report.failed_action.id == 1 and report.steps_done == 1
    assert "cannot start" in report.reason and ("cancel", 0) not in world.published
