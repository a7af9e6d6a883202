"""The Executor's state machine: a state for every component of the planning system (paper, section 3.2.2)."""

import threading
import time
from typing import Any, Callable, List, Optional, Sequence

import rospy
from merlin_msgs.msg import ExecuteResult
from rosplan_dispatch_msgs.msg import ActionDispatch

import smach
from merlin_executor.own_goals import OwnGoals
from merlin_executor.request import Request
from merlin_sm.deadline import Deadline
from merlin_sm.dispatch_client import DispatchClient, DispatchResult
from merlin_sm.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.pddl_text import to_pddl
from merlin_sm.planning_client import PlanningClient
from merlin_sm.service_proxy import ServiceError
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.planning import (
    CANCEL_TIMEOUT,
    FAILED,
    TIMEOUT,
    UNSOLVABLE,
    DispatchPlanState,
    GenerateProblemState,
    ParsePlanState,
    PlanState,
)

ALREADY_TRUE = "already_true"
EXHAUSTED = "exhausted"
REMOVE_GOALS = "REMOVE_GOALS"
REPLAN_WAIT = 1.0
"""Running time before the second new plan, s; twice as long before each further one. What makes a plan fail
at once, such as an action that has not ended yet, may pass."""

_OUTCOMES = {
    name.lower(): getattr(ExecuteResult, name)
    for name in (
        "SUCCEEDED",
        "ALREADY_TRUE",
        "CANCELLED",
        "UNSOLVABLE",
        "PLANNER_TIMEOUT",
        "PLANNER_ERROR",
        "ACTION_FAILED",
        "CANCEL_TIMEOUT",
        "INTERNAL",
    )
}
_VERDICTS = {
    SUCCEEDED: "succeeded",
    ALREADY_TRUE: "already_true",
    PREEMPTED: "cancelled",
    UNSOLVABLE: "unsolvable",
    TIMEOUT: "planner_timeout",
    EXHAUSTED: "action_failed",
    CANCEL_TIMEOUT: "cancel_timeout",
}
"""Outcome of the last stage → outcome of the machine; aborted depends on the stage."""


class ExecutorSM(MerlinSM):
    """Adds the goals of a request, has the problem written, planned, parsed and dispatched, and removes them.

    :param knowledge: of the planning system.
    :param planning: its stages before dispatch.
    :param dispatcher: its dispatcher.
    :param own: the goals it puts into the knowledge base.
    :param max_replans: how often a failed dispatch is planned again, from the world as it is.
    :param on_change: called when the stage changes.
    """

    def __init__(
        self,
        knowledge: KnowledgeClient,
        planning: PlanningClient,
        dispatcher: DispatchClient,
        own: OwnGoals,
        max_replans: int,
        on_change: Callable[[], None],
    ) -> None:
        super().__init__(list(_OUTCOMES))
        self._on_change = on_change
        self._entered = 0.0
        self._stage = ""
        self.request: Optional[Request] = None
        with self:
            self._add_stages(knowledge, planning, dispatcher, own, max_replans)
        self.register_start_cb(self._enter)
        self.register_transition_cb(self._enter)
        self.register_termination_cb(self._enter)

    def run_request(self, request: Request) -> int:
        """Runs a request; :meth:`prepare` comes before, :meth:`cancel` stops it from any thread.

        :return: a constant of ExecuteResult; :attr:`reason` says why.
        """
        self.request = request
        self._stage = ""
        outcome = self.execute()
        self.request = None
        return int(_OUTCOMES.get(outcome, ExecuteResult.INTERNAL))

    def verdict(self) -> str:
        """The machine's outcome, as the stage that ended the request left it."""
        assert self.request is not None
        stage = self[self.request.stage]
        if stage.outcome == ABORTED:
            return "planner_error" if self.request.stage == "PLAN" else "internal"
        return _VERDICTS[stage.outcome]

    def _add_stages(
        self,
        knowledge: KnowledgeClient,
        planning: PlanningClient,
        dispatcher: DispatchClient,
        own: OwnGoals,
        max_replans: int,
    ) -> None:
        def stage(label: str, state: MerlinState, follows: str, **transitions: str) -> None:
            ends = dict.fromkeys(state.get_registered_outcomes(), REMOVE_GOALS)
            self.add(label, state, transitions={**ends, SUCCEEDED: follows, **transitions})

        add_goals = _AddGoals(knowledge, own, lambda: self.request)
        stage("ADD_GOALS", add_goals, "GENERATE_PROBLEM")
        stage("GENERATE_PROBLEM", GenerateProblemState(planning), "PLAN")
        stage("PLAN", PlanState(planning), "PARSE_PLAN")
        stage("PARSE_PLAN", ParsePlanState(planning, self._take_plan), "DISPATCH_PLAN")
        dispatch = DispatchPlanState(dispatcher, self._take_result, self._plan)
        stage("DISPATCH_PLAN", dispatch, REMOVE_GOALS, **{FAILED: "REPLAN"})
        stage("REPLAN", _Replan(dispatch, lambda: self.request, max_replans), "GENERATE_PROBLEM")
        self.add(REMOVE_GOALS, _RemoveGoals(own, self.verdict, list(_OUTCOMES)))

    def _plan(self) -> Sequence[ActionDispatch]:
        assert self.request is not None
        return self.request.plan

    def _take_plan(self, actions: list) -> None:
        assert self.request is not None
        self.request.plan = actions

    def _take_result(self, result: DispatchResult) -> None:
        assert self.request is not None
        self.request.action = result.action

    def _enter(self, userdata: Any, states: List[str], *outcome: str) -> None:
        now = time.monotonic()
        request = self.request
        if request is None:
            return
        if self._stage:
            times = request.stage_times
            times[self._stage] = times.get(self._stage, 0.0) + now - self._entered
        self._entered = now
        self._stage = "" if outcome else states[0]
        if self._stage and self._stage != REMOVE_GOALS:
            request.stage = self._stage
        self._on_change()

    def _take_reason(self, userdata: Any, terminal_states: List[str], outcome: str) -> None:
        assert self.request is not None
        self.reason = self[self.request.stage].reason
        if self.request.replans and self.request.stage == "PLAN":
            # That there is no other way says little without what made another way necessary.
            self.reason = f"{self['REPLAN'].reason}; planned again: {self.reason}"


class _AddGoals(MerlinState):
    """Adds the goals that are not there yet; ends with already_true when all of them hold."""

    def __init__(self, knowledge: KnowledgeClient, own: OwnGoals, request: Callable[[], Request]) -> None:
        super().__init__(outcomes=[ALREADY_TRUE])
        self._knowledge = knowledge
        self._own = own
        self._request = request

    def run(self, userdata: Any) -> str:
        """Adds them."""
        items = self._request().items
        try:
            self._own.remove()  # what an earlier request could not remove
            if all(self._knowledge.query(items)):
                self.reason = "the goal holds already"
                return ALREADY_TRUE
            present = {to_pddl(goal).lower() for goal in self._knowledge.goals()}
            self._own.add([item for item in items if to_pddl(item).lower() not in present])
        except (KnowledgeError, ServiceError, OSError) as error:
            return self.fail(str(error))
        return SUCCEEDED


class _Replan(MerlinState):
    """Lets the goal be planned again, a bounded number of times."""

    def __init__(self, dispatch: DispatchPlanState, request: Callable[[], Request], max_replans: int) -> None:
        super().__init__(outcomes=[EXHAUSTED])
        self._dispatch = dispatch
        self._request = request
        self._max_replans = max_replans

    def run(self, userdata: Any) -> str:
        """Counts, and waits before all new plans but the first."""
        request = self._request()
        self.reason = self._dispatch.reason
        if request.replans >= self._max_replans:
            if self._max_replans:
                self.reason += f" (planned again {request.replans} times)"
            return EXHAUSTED
        request.replans += 1
        if request.replans > 1 and self._cancelled_within(REPLAN_WAIT * 2 ** (request.replans - 2)):
            return PREEMPTED
        rospy.loginfo(f"planning again ({request.replans} of {self._max_replans}): {self.reason}")
        return SUCCEEDED

    def _cancelled_within(self, seconds: float) -> bool:
        cancelled = threading.Event()
        self.interruptible(cancelled.set)
        try:
            return Deadline(seconds).wait_event(cancelled)
        finally:
            self.interruptible(None)


class _RemoveGoals(smach.State):
    """Removes the goals that were added, whatever happened, and gives the machine its outcome."""

    def __init__(self, own: OwnGoals, verdict: Callable[[], str], outcomes: List[str]) -> None:
        super().__init__(outcomes=outcomes)
        self._own = own
        self._verdict = verdict

    def execute(self, userdata: Any) -> str:
        """Removes them also when the run is being preempted."""
        self.service_preempt()
        try:
            self._own.remove()
        except (KnowledgeError, ServiceError) as error:
            rospy.logerr(f"the goals of the request stay in the knowledge base: {error}")
        except OSError as error:
            rospy.logerr(f"that the goals of the request are removed cannot be noted: {error}")
        return self._verdict()
