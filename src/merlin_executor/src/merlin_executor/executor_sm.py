"""The Executor's state machine: a state for every component of the planning system (paper, section 3.2.2).

Its states carry out; what a failure or a stop means is decided in :mod:`merlin_executor.course`,
:mod:`merlin_executor.replanning` and :mod:`merlin_executor.standstill`.
"""

import threading
import time
from typing import Any, Callable, List, NamedTuple, Optional, Sequence

import rospy
from rosplan_dispatch_msgs.msg import ActionDispatch

import smach
from merlin_executor.course import REPLAN, Course, StageEnd
from merlin_executor.engine import Stages
from merlin_executor.guard_client import GuardClient
from merlin_executor.outcome import Outcome, StopKind, Verdict
from merlin_executor.own_goals import OwnGoals
from merlin_executor.recovery import Recovery
from merlin_executor.request import Request
from merlin_executor.standstill import STAND_WAIT, still_moving, unstopped
from merlin_sm.deadline import Deadline
from merlin_sm.dispatch_client import PART as DISPATCHER
from merlin_sm.dispatch_client import DispatchClient
from merlin_sm.dispatch_progress import DispatchResult
from merlin_sm.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.pddl_text import to_pddl
from merlin_sm.planning_client import PlanningClient, StageError
from merlin_sm.service_proxy import ServiceError, ServiceUnavailable
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.planning import (
    FAILED,
    DispatchPlanState,
    GenerateProblemState,
    ParsePlanState,
    PlanningState,
    PlanState,
)

ALREADY_TRUE = "already_true"
EXHAUSTED = "exhausted"
REMOVE_GOALS = "REMOVE_GOALS"
KNOWLEDGE_BASE = "the planning system's knowledge base"
_OUTCOMES = [outcome.name.lower() for outcome in Outcome if outcome not in (Outcome.DROPPED, Outcome.REFUSED)]


class PlanningSystem(NamedTuple):
    """The parts of a planning system, and what watches over the robot that it moves."""

    knowledge: KnowledgeClient
    planning: PlanningClient
    dispatcher: DispatchClient
    recovery: Recovery
    guard: GuardClient
    return_wait: float
    """s of running time for a part that was ended to return."""


class ExecutorSM(MerlinSM, Stages[Request]):
    """Adds the goals of a request, has the problem written, planned, parsed and dispatched, and removes them.

    :param system: that it drives.
    :param own: the goals it puts into the knowledge base.
    :param on_change: called when the stage changes.
    """

    def __init__(self, system: PlanningSystem, own: OwnGoals, on_change: Callable[[], None]) -> None:
        super().__init__(_OUTCOMES)
        self._system = system
        self._own = own
        self._on_change = on_change
        self._verdict = Verdict(Outcome.INTERNAL)
        self._request: Optional[Request] = None
        with self:
            self._add_stages()
        self.register_start_cb(self._enter)
        self.register_transition_cb(self._enter)
        self.register_termination_cb(self._enter)

    def run_request(self, request: Request) -> Verdict:
        """Runs a request; :meth:`prepare` comes before, :meth:`cancel` stops it from any thread."""
        self._request = request
        # Stays so where SMACH stops the machine because the node ends.
        self._verdict = Verdict(Outcome.CANCELLED, StopKind.SHUTDOWN.value)
        try:
            self.execute()
        finally:
            self._request = None
        return self._verdict

    @property
    def request(self) -> Request:
        """The request that runs."""
        assert self._request is not None
        return self._request

    @property
    def course(self) -> Course:
        """Of the request that runs."""
        return self.request.course

    def _add_stages(self) -> None:
        def stage(label: str, state: MerlinState, follows: str, **transitions: str) -> None:
            ends = dict.fromkeys(state.get_registered_outcomes(), REMOVE_GOALS)
            self.add(label, state, transitions={**ends, ABORTED: REPLAN, SUCCEEDED: follows, **transitions})

        system, planning = self._system, self._system.planning
        dispatch = DispatchPlanState(
            system.dispatcher, self._take_result, lambda: self.request.plan, lambda: self.request.goal.id
        )
        stage("SETTLE", _Settle(system.recovery), "ADD_GOALS")
        stage("ADD_GOALS", _AddGoals(system.knowledge, self._own, self), "GENERATE_PROBLEM")
        stage("GENERATE_PROBLEM", GenerateProblemState(planning), "PLAN")
        stage("PLAN", PlanState(planning), "PARSE_PLAN")
        stage("PARSE_PLAN", ParsePlanState(planning, self._take_plan), "DISPATCH_PLAN")
        stage("DISPATCH_PLAN", dispatch, REMOVE_GOALS, **{FAILED: REPLAN})
        stage(REPLAN, _Replan(system, self), "SETTLE", **{ABORTED: REMOVE_GOALS})
        self.add(REMOVE_GOALS, _RemoveGoals(self._finish))

    def _take_plan(self, actions: Sequence[ActionDispatch]) -> None:
        self.request.plan = list(actions)

    def _take_result(self, result: DispatchResult) -> None:
        course = self.course
        course.action, course.unstopped, course.timed_out = result.action, result.unstopped, result.timed_out

    def _enter(self, userdata: Any, states: List[str], *outcome: str) -> None:
        course = self.course
        if course.stage and course.stage != REMOVE_GOALS:
            left = self[course.stage]
            if course.stage != REPLAN or left.outcome in (PREEMPTED, ABORTED):
                course.ended(StageEnd(course.stage, left.outcome, left.reason, left.gone))
        course.enter("" if outcome else states[0], time.monotonic())
        self._on_change()

    def _finish(self) -> str:
        """The end of every run: the truth about what has stopped, then the goals are removed."""
        course, guard = self.course, self._system.guard
        verdict = course.verdict()
        if verdict.outcome is Outcome.CANCEL_TIMEOUT:
            told = course.timed_out or self.request.stop is None
            verdict = unstopped(course.unstopped, guard.halt(), verdict.reason if told else "")
        elif course.dispatched and not verdict.outcome.achieved and not guard.wait_standing(STAND_WAIT):
            verdict = still_moving(verdict, guard.halt())
        if not course.unreachable and not course.timed_out:
            self.clean_up()
        # Otherwise the next request removes them: the answer does not wait for what does not answer.
        self._verdict = verdict
        return verdict.outcome.name.lower()

    def clean_up(self) -> None:
        """Removes the goals that were added; what fails is logged, and done before the next request."""
        try:
            self._own.remove()
        except (KnowledgeError, ServiceError) as error:
            rospy.logerr(f"the goals of the request stay in the knowledge base: {error}")
        except OSError as error:
            rospy.logerr(f"that the goals of the request are removed cannot be noted: {error}")


def _of_knowledge_base(error: ServiceError) -> StageError:
    return StageError(f"{KNOWLEDGE_BASE}: {error}", gone=isinstance(error, ServiceUnavailable))


class _Settle(PlanningState):
    """Brings the planning system to rest: nothing is planned on what something still changes."""

    def __init__(self, recovery: Recovery) -> None:
        super().__init__()
        self._recovery = recovery

    def run(self, userdata: Any) -> str:
        """Looks, and waits where something is left."""
        try:
            trouble = self._recovery.rest(self.interruptible)
        except ServiceError as error:
            return self.fail_stage(_of_knowledge_base(error))
        if self.preempt_requested():
            return PREEMPTED
        return self.fail(trouble) if trouble else SUCCEEDED


class _AddGoals(PlanningState):
    """Adds the goals that are not there yet; ends with already_true when all of them hold."""

    def __init__(self, knowledge: KnowledgeClient, own: OwnGoals, machine: ExecutorSM) -> None:
        super().__init__([ALREADY_TRUE])
        self._knowledge = knowledge
        self._own = own
        self._machine = machine

    def run(self, userdata: Any) -> str:
        """Adds them."""
        items = self._machine.request.items
        try:
            if not self._machine.course.is_replan:
                self._own.remove()  # what an earlier request could not remove
            if all(self._knowledge.query(items)):
                self.reason = "the goal holds already"
                return ALREADY_TRUE
            present = {to_pddl(goal).lower() for goal in self._knowledge.goals()}
            self._own.add([item for item in items if to_pddl(item).lower() not in present])
        except ServiceError as error:
            return self.fail_stage(_of_knowledge_base(error))
        except (KnowledgeError, OSError) as error:
            return self.fail(str(error))
        return SUCCEEDED


class _Replan(PlanningState):
    """Has the goal planned again where that may help; waits for a planning system that was ended."""

    def __init__(self, system: PlanningSystem, machine: ExecutorSM) -> None:
        super().__init__([EXHAUSTED])
        self._system = system
        self._machine = machine

    def run(self, userdata: Any) -> str:
        """Decides, and waits before all new plans but the first."""
        course = self._machine.course
        end = course.end
        decision = course.replan()
        self.reason = end.reason
        if not decision.again:
            return EXHAUSTED
        cancelled = threading.Event()
        self.interruptible(cancelled.set)
        try:
            if end.gone and not self._back(cancelled):
                return PREEMPTED if cancelled.is_set() else ABORTED
            if Deadline(decision.wait).wait_event(cancelled):
                return PREEMPTED
        finally:
            self.interruptible(None)
        rospy.loginfo(f"planning again ({course.replans}): {self.reason}")
        return SUCCEEDED

    def _back(self, cancelled: threading.Event) -> bool:
        """Whether all parts of the planning system are there, or return in time."""
        dispatcher, wait = self._system.dispatcher, self._system.return_wait
        rospy.logwarn(f"{self.reason}; waits {wait:g} s for its return")
        part = self._system.planning.wait_back(
            wait, cancelled, lambda: "" if dispatcher.available() else DISPATCHER
        )
        if part and not cancelled.is_set():
            self.gone = True
            self.reason = f"{self.reason}; {part} did not return within {wait:g} s"
        return not part and not cancelled.is_set()


class _RemoveGoals(smach.State):
    """Ends every run, whatever happened, and gives the machine its outcome.

    :param finish: does that, also when the run is being preempted.
    """

    def __init__(self, finish: Callable[[], str]) -> None:
        super().__init__(outcomes=_OUTCOMES)
        self._finish = finish

    def execute(self, userdata: Any) -> str:
        """Ends the run."""
        self.service_preempt()
        return self._finish()
