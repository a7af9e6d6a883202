# SPDX-License-Identifier: Apache-2.0
"""A dispatch whose plan no longer fits the world: what is stopped, skipped and reported."""

from dispatch_world import PATIENT, PLAN_ID, Run
from rest_world import RestWorld, planned

from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import DispatchLimits, DispatchState, FeedbackStatus
from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule

DOMAIN = """(define (domain d) (:predicates (here) (there) (open) (done))
  (:action go :precondition (here) :effect (and (there) (not (here))))
  (:action unlock :precondition (not (open)) :effect (open))
  (:action pass :precondition (and (there) (open)) :effect (done)))"""


class WatchedRun(Run):
    """A dispatch over a store, in a thread of its own."""

    def __init__(self, *texts, init="(here) (open)", **limits):
        actions = planned(*texts)
        problem = f"(define (problem p) (:domain d) (:init {init}) (:goal (done)))"
        self.world = RestWorld(DOMAIN, problem, actions)
        self.limits = DispatchLimits(**{**PATIENT, **limits})
        super().__init__(self.world, SequentialSchedule(actions))

    def _run(self):
        self.dispatch = PlanDispatch(
            SequentialSchedule(self.world.actions),
            self.world,
            self.limits,
            PLAN_ID,
            watch=self.world.watch,
        )
        self.world.listeners = [self.dispatch.put]
        self._report = self.dispatch.run()

    def take(self, number):
        self.world.wait("action", number)
        self.feedback(number, FeedbackStatus.ENABLED)
        self.world.begin(number)

    def succeed(self, number):
        self.world.finish(number)
        self.feedback(number, FeedbackStatus.SUCCEEDED)


def test_a_plan_that_no_longer_fits_is_ended_while_its_first_action_runs():
    run = WatchedRun("(go)", "(pass)")
    run.take(0)
    run.world.make("(not (open))")
    run.world.wait("cancel", 0)
    run.feedback(0, FeedbackStatus.FAILED, reason="cancelled")
    report = run.report()
    assert report.state is DispatchState.FAILED and str(report.failed_action) == "(pass)"
    assert (
        report.reason
        == "the plan no longer fits: step 2, (pass), cannot be carried out: (open) does not hold"
    )


def test_a_step_that_is_not_needed_any_more_is_not_sent():
    run = WatchedRun("(go)", "(unlock)", "(pass)", init="(here)")
    run.take(0)
    run.world.make("(open)")
    run.succeed(0)
    run.take(2)
    run.succeed(2)
    report = run.report()
    assert report.success and report.steps_done == 3
    assert ("action", 1) not in run.world.published


def test_a_goal_that_comes_true_stops_what_runs_and_is_a_success():
    run = WatchedRun("(go)", "(pass)")
    run.take(0)
    run.world.make("(done)")
    run.world.wait("cancel", 0)
    assert not run.dispatch.ended.is_set()
    run.feedback(0, FeedbackStatus.FAILED, reason="cancelled")
    report = run.report()
    assert report.success and report.reason == "the goal holds already: the rest of the plan is not needed"


def test_it_is_none_while_an_action_does_not_stop():
    run = WatchedRun("(go)", "(pass)", cancel=0.0)
    run.take(0)
    run.world.make("(done)")
    run.world.wait("cancel", 0)
    report = run.report()
    assert not report.success and "no answer to the cancel from (go)" in report.reason


def test_it_is_none_when_an_action_says_that_it_does_not_stop():
    run = WatchedRun("(go)", "(pass)")
    run.take(0)
    run.world.make("(done)")
    run.world.wait("cancel", 0)
    run.feedback(0, FeedbackStatus.FAILED, reason="cancelled", unstopped=True)
    report = run.report()
    assert report.state is DispatchState.FAILED and report.reason.endswith("; (go) did not stop")
