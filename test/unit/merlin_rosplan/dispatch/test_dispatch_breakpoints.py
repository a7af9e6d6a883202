# SPDX-License-Identifier: Apache-2.0
"""A dispatch that is held before an action, steps, goes on, and is cancelled meanwhile."""

import pytest
from dispatch_world import PATIENT, PLAN_ID, WORK, World, actions
from dispatch_world import Run as PlainRun

from merlin_pddl.breakpoints import Breakpoints
from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchLimits,
    DispatchState,
    Feedback,
    FeedbackStatus,
    Tick,
)
from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule
from merlin_test import LONG


class HeldWorld(World):
    """Notes what is held at each report."""

    def __init__(self, points):
        super().__init__(WORK)
        self.points = points
        self.held = []

    def changed(self, report):
        self.held.append(self.points.held)
        super().changed(report)

    def wait_held(self, text):
        with self.changed_event:
            assert self.changed_event.wait_for(lambda: self.held and self.held[-1] == text, LONG), self.held


class Run(PlainRun):
    def __init__(self, world, count):
        self.world = world
        schedule = SequentialSchedule(actions(*["work"] * count))
        self.made = PlanDispatch(
            schedule, world, DispatchLimits(**PATIENT), PLAN_ID, breakpoints=world.points
        )
        super().__init__(world, schedule)

    def _run(self):
        self.dispatch = self.made
        self._report = self.made.run()

    def done(self, action_id):
        self.world.wait("action", action_id)
        self.made.put(self.reported(action_id, FeedbackStatus.ENABLED))
        self.made.put(self.reported(action_id, FeedbackStatus.SUCCEEDED))

    @staticmethod
    def reported(action_id, status):

        return Feedback(action_id, int(status), PLAN_ID)


@pytest.fixture
def points():
    return Breakpoints()


@pytest.fixture
def world(points):
    return HeldWorld(points)


def test_it_is_held_before_the_action_and_goes_on(world, points):
    points.set(["(work o1)"])
    run = Run(world, 3)
    run.done(0)
    world.wait_held("(work o1)")
    assert ("action", 1) not in world.published
    points.go_on()
    run.made.put(Tick())
    run.done(1)
    run.done(2)
    assert run.report().success and world.held[-1] == ""


def test_a_step_begins_one_action(world, points):
    points.set(["work"])
    run = Run(world, 3)
    world.wait_held("(work o0)")
    points.set([])
    points.step()
    run.made.put(Tick())
    run.done(0)
    world.wait_held("(work o1)")
    assert ("action", 1) not in world.published
    points.go_on()
    run.made.put(Tick())
    run.done(1)
    run.done(2)
    assert run.report().success


def test_what_is_held_can_be_cancelled_and_is_forgotten(world, points):
    points.set(["work"])
    run = Run(world, 2)
    world.wait_held("(work o0)")
    points.step()
    run.made.cancel("cancelled by the test")
    report = run.report()
    assert report.state == DispatchState.CANCELLED
    assert points.held == ""
    points.set([])
    assert not points.armed, "a step does not outlive its request"
