# SPDX-License-Identifier: Apache-2.0
"""States for the stages of the planning system (paper, section 3.2.2: a state for every component)."""

from typing import Any, Callable, List, Optional, Sequence

from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_planning.dispatch_client import DispatchClient
from merlin_planning.dispatch_progress import DispatchResult
from merlin_planning.knowledge_text import step_text
from merlin_planning.planning_client import Planned, PlanningClient, StageError
from merlin_ros.call_scope import CallScope
from merlin_ros.master.master_link import master_answers
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, MerlinState

UNSOLVABLE = "unsolvable"
NO_PLAN = "no_plan"
TIMEOUT = "timeout"
FAILED = "failed"
CANCEL_TIMEOUT = "cancel_timeout"
CALL_GRACE = 1.0  # s of wall time that a service call under way still gets when its state is preempted


class PlanningState(MerlinState):
    """Base of the states of the planning system's stages.

    A preempt ends a service call that has no answer after :data:`CALL_GRACE`; the reason then names the part.

    :ivar gone: after a run that failed, whether a part of the planning system, or the master, is gone or did
        not answer.
    """

    def __init__(self, outcomes: Sequence[str] = (), output_keys: Sequence[str] = ()) -> None:
        super().__init__(outcomes, (), output_keys)
        self.gone = False
        self._calls: Optional[CallScope] = None

    def execute(self, userdata: Any) -> str:
        """Runs the state; SMACH calls it."""
        self.gone = False
        with CallScope() as self._calls:
            outcome = super().execute(userdata)
        failed = outcome in (ABORTED, FAILED) and not self.preempt_requested()
        if failed and not self.gone and not master_answers():
            self.gone = True  # whatever part it was that failed, none works without a master
        if outcome == ABORTED and self._calls.gave_up:
            self.service_preempt()
            self.outcome = PREEMPTED
        return self.outcome

    def request_preempt(self) -> None:
        """Sets the flag, interrupts what the state waits for, and limits its service calls."""
        super().request_preempt()
        self.end_calls()

    def end_calls(self) -> None:
        """Limits the service calls of a state that is preempted."""
        calls = self._calls
        if calls is not None:
            calls.end(CALL_GRACE)

    def fail_stage(self, error: StageError) -> str:
        """Remembers why a stage failed and returns the outcome aborted."""
        self.gone = error.gone
        return self.fail(str(error))


class GenerateProblemState(PlanningState):
    """Generates the problem from the knowledge base.

    :param client: of the planning system; None: one with the usual names.
    """

    def __init__(self, client: Optional[PlanningClient] = None) -> None:
        super().__init__()
        self._client = client or PlanningClient()

    def run(self, userdata: Any) -> str:
        """Has the problem generated from the knowledge base."""
        try:
            self._client.generate_problem()
        except StageError as error:
            return self.fail_stage(error)
        return SUCCEEDED


class PlanState(PlanningState):
    """Calls the planner. A preempt cancels the planner.

    Further outcomes are unsolvable (proven), no_plan (the planner gave up) and timeout.

    :param client: of the planning system; None: one with the usual names.
    :param without: gives the actions that the plan has to do without, see :meth:`PlanningClient.plan`.
    """

    def __init__(
        self, client: Optional[PlanningClient] = None, without: Callable[[], Sequence[str]] = lambda: ()
    ) -> None:
        super().__init__([UNSOLVABLE, NO_PLAN, TIMEOUT])
        self._without = without
        self._client = client or PlanningClient()

    def run(self, userdata: Any) -> str:
        """Calls the planner; the outcome says what it found."""
        result = self._client.plan(self.interruptible, self._without())
        self.reason, self.gone = result.reason, result.gone
        return {
            Planned.SOLVED: SUCCEEDED,
            Planned.UNSOLVABLE: UNSOLVABLE,
            Planned.NO_PLAN: NO_PLAN,
            Planned.TIMEOUT: TIMEOUT,
            Planned.CANCELLED: PREEMPTED if self.preempt_requested() else ABORTED,
        }.get(result.verdict, ABORTED)


class ParsePlanState(PlanningState):
    """Calls the parser and puts the plan's actions, as PDDL text, into ``userdata.plan``.

    :param client: of the planning system; None: one with the usual names.
    :param on_plan: called with the actions.
    """

    def __init__(
        self,
        client: Optional[PlanningClient] = None,
        on_plan: Callable[[List[ActionDispatch]], None] = lambda actions: None,
    ) -> None:
        super().__init__(output_keys=["plan"])
        self._client = client or PlanningClient()
        self._on_plan = on_plan

    def run(self, userdata: Any) -> str:
        """Has the plan parsed and keeps its actions."""
        try:
            actions = self._client.parse_plan()
        except StageError as error:
            return self.fail_stage(error)
        userdata.plan = list(map(step_text, actions))
        self._on_plan(actions)
        return SUCCEEDED


class DispatchPlanState(PlanningState):
    """Dispatches the plan. A preempt cancels the dispatch.

    Outcomes: succeeded when the goal holds, failed when an action failed or the goal does not hold (plan
    again), cancel_timeout when something did not stop in time, preempted, aborted.

    :param client: of the dispatcher; None: one with the usual names.
    :param on_result: called with the result.
    :param plan: gives the actions that are meant, see :meth:`DispatchClient.dispatch`.
    :param owner: gives the id of the goal of this process's own server on whose behalf they are dispatched.
    """

    def __init__(
        self,
        client: Optional[DispatchClient] = None,
        on_result: Callable[[DispatchResult], None] = lambda result: None,
        plan: Callable[[], Sequence[ActionDispatch]] = lambda: (),
        owner: Callable[[], Optional[str]] = lambda: None,
    ) -> None:
        super().__init__([FAILED, CANCEL_TIMEOUT])
        self._plan = plan
        self._owner = owner
        self._client = client or DispatchClient()
        self._on_result = on_result

    def end_calls(self) -> None:
        """Limits nothing: a cancel is a call too. The client bounds them all by its cancel deadline."""

    def run(self, userdata: Any) -> str:
        """Dispatches the plan and waits for its end."""
        result = self._client.dispatch(self.interruptible, self._plan(), self._owner())
        self._on_result(result)
        self.gone = result.gone
        named = result.action and not result.timed_out and not result.reason.startswith(result.action)
        self.reason = f"{result.action}: {result.reason}" if named else result.reason
        if result.goal_achieved:
            return SUCCEEDED
        if result.timed_out or result.unstopped:
            return CANCEL_TIMEOUT
        if result.cancelled and self.preempt_requested():
            return PREEMPTED
        return FAILED
