# SPDX-License-Identifier: Apache-2.0
"""The Executor's state machine: a state for every component of the planning system (paper, section 3.2.2).

The state factory makes its states (paper, section 3.2.1). They carry out; what a failure or a stop means is
decided in :mod:`merlin_executor.core.course`, :mod:`merlin_executor.core.replanning` and
:mod:`merlin_executor.core.standstill`.
"""

import time
from typing import Any, Callable, List, Optional, Sequence, cast

import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch

import smach
from merlin_executor.core.course import REPLAN, Course, StageEnd
from merlin_executor.core.engine import Engine, Stages
from merlin_executor.core.outcome import Outcome, StopKind, Verdict
from merlin_executor.core.standstill import still_moving, unstopped
from merlin_executor.node.executor_stages import KNOWLEDGE_BASE, ROBOT_BACK
from merlin_executor.node.joint_run import JointRun, PlanningSystem
from merlin_executor.node.own_goals import OwnGoals
from merlin_executor.node.request import Request
from merlin_planning.dispatch_progress import DispatchResult
from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceError
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_sm.states.planning import FAILED, PlanningState

REMOVE_GOALS = "REMOVE_GOALS"
REMOVE_LIMIT = 5.0  # s of wall time for the goals to be removed before the answer; later that is tried again
REMOVE_LIMIT_STOPPED = 1.0  # the same when the answer is to a cancel
_OUTCOMES = [outcome.name.lower() for outcome in Outcome if outcome is not Outcome.DROPPED]


class ExecutorSM(MerlinSM, Stages[Request]):
    """Adds the goals of requests, has the problem written, planned, parsed and dispatched, and removes them.

    :param system: that it drives.
    :param own: the goals it puts into the knowledge base.
    :param on_change: called when the stage changes.
    :param engine: gives the one that has all requests.
    """

    def __init__(
        self,
        system: PlanningSystem,
        own: OwnGoals,
        on_change: Callable[[], None],
        engine: Callable[[], Engine[Request]],
    ) -> None:
        super().__init__(_OUTCOMES)
        self._system = system
        self._own = own
        self._on_change = on_change
        self._engine = engine
        self._verdict = Verdict(Outcome.INTERNAL)
        self._joint_run: Optional[JointRun] = None
        with self:
            self._add_stages()
        self.register_start_cb(self._enter)
        self.register_transition_cb(self._enter)
        self.register_termination_cb(self._enter)

    def run_requests(self, requests: Sequence[Request]) -> Verdict:
        """Runs requests; :meth:`prepare` comes before, :meth:`cancel` stops them from any thread."""
        self._joint_run = run = JointRun(requests, self._system, self._own, self._engine())
        # Stays so where SMACH stops the machine because the node ends.
        self._verdict = Verdict(Outcome.CANCELLED, StopKind.SHUTDOWN.value)
        try:
            self.execute()
        finally:
            self._joint_run = None
            run.close()
        return self._verdict

    def dispatch_changed(self) -> None:
        """The dispatch under way has changed; called by a subscriber."""
        run = self._joint_run
        if run is not None:
            run.dispatch_changed()

    def revise(self) -> bool:
        """Has the plan exchanged while its actions go on; see :meth:`.Stages.revise`."""
        run = self._joint_run
        return run is not None and run.revision.ask()

    def cancel(self) -> None:
        """Stops the run, also one that is prepared and has not begun; from any thread.

        With several guards it waits for them, at most ``guard_client.BRAKE_WAIT``.
        """
        run = self._joint_run
        try:
            if run is not None:
                run.cancel()
                if run.course.may_move:
                    self._system.guard.brake(f"{rospy.get_name()} cancels its action")
        finally:  # the brake only gains time
            super().cancel()

    @property
    def run(self) -> JointRun:
        """The requests that run."""
        assert self._joint_run is not None
        return self._joint_run

    @property
    def course(self) -> Course:
        """The stages, failures and verdict of the run."""
        return self.run.course

    def _add_stages(self) -> None:
        def stage(label: str, made: smach.State, follows: str, **transitions: str) -> None:
            ends = dict.fromkeys(made.get_registered_outcomes(), REMOVE_GOALS)
            self.add(label, made, transitions={**ends, ABORTED: REPLAN, SUCCEEDED: follows, **transitions})

        system, planning, make = self._system, self._system.planning, MerlinStateFactory.create
        stage("SETTLE", make("settle", system), "ADD_GOALS")
        stage("ADD_GOALS", make("add_goals", system, self._own, self), "GENERATE_PROBLEM")
        stage("GENERATE_PROBLEM", make("generate_problem", planning), "PLAN")
        stage("PLAN", make("plan_in_time", system, self), "PARSE_PLAN", **{ROBOT_BACK: "SETTLE"})
        stage("PARSE_PLAN", make("parse_plan", planning, self._take_plan), "DISPATCH_PLAN")
        dispatch = make("dispatch_goals", system, self)
        stage("DISPATCH_PLAN", dispatch, REMOVE_GOALS, **{FAILED: REPLAN})
        stage(REPLAN, make("replan", system, self), "SETTLE", **{ABORTED: REMOVE_GOALS})
        self.add(REMOVE_GOALS, make("remove_goals", _OUTCOMES, self._finish))

    def _take_plan(self, actions: Sequence[ActionDispatch]) -> None:
        for request in self.run.requests:
            request.take_plan(actions, reached=self.run.reached.get(request))

    def take_result(self, result: DispatchResult) -> None:
        """Notes how a dispatch has ended."""
        self.course.dispatched = result

    def _enter(self, userdata: Any, states: List[str], *outcome: str) -> None:
        course = self.course
        if course.stage and course.stage != REMOVE_GOALS:
            left = cast(PlanningState, self[course.stage])
            if course.stage != REPLAN or left.outcome in (PREEMPTED, ABORTED):
                course.ended(StageEnd(course.stage, left.outcome, left.reason, left.gone))
        course.enter("" if outcome else states[0], time.monotonic())
        self._on_change()

    def _finish(self) -> str:
        """The end of every run: the truth about what has stopped, then the goals are removed."""
        course, guard = self.course, self._system.guard
        verdict, dispatched = course.verdict(), course.dispatched
        if verdict.outcome is Outcome.CANCEL_TIMEOUT:
            reason = verdict.reason if dispatched.timed_out or not self.run.stopped else ""
            verdict = unstopped(dispatched.unstopped, guard.halt(), reason, dispatched.held_up_by)
        elif course.may_move and self._stopped_early(verdict) and not guard.wait_standing():
            verdict = still_moving(verdict, guard.halt())
        if not course.unreachable and not dispatched.timed_out:
            trouble = self._remove_goals(REMOVE_LIMIT_STOPPED if self.run.stopped else REMOVE_LIMIT)
            verdict = verdict._replace(trouble=verdict.trouble or trouble)
        # Otherwise they are removed later: the answer does not wait for what does not answer.
        self._verdict = verdict
        return verdict.outcome.name.lower()

    def _stopped_early(self, verdict: Verdict) -> bool:
        """Whether an action may have been stopped: a goal may come true while the base drives."""
        return not verdict.outcome.achieved or self._system.dispatcher.steps_done < len(self.run.request.plan)

    @property
    def left(self) -> bool:
        """Whether goals of a request are still in the knowledge base."""
        return self._own.left

    def clean_up(self) -> None:
        """Removes the goals that were added; what fails is logged, and tried again."""
        self._remove_goals(REMOVE_LIMIT_STOPPED)

    def _remove_goals(self, limit: float) -> str:
        """Returns why they stay, as a sentence; empty when they are removed."""
        try:
            with CallScope(limit):
                self._own.remove()
        except (KnowledgeError, ServiceError) as error:
            rospy.logerr_throttle_identical(
                60.0, f"the goals of the request stay in the knowledge base: {error}"
            )
            return f"{KNOWLEDGE_BASE}: {error}"
        except OSError as error:
            rospy.logerr(f"that the goals of the request are removed cannot be noted: {error}")
        return ""
