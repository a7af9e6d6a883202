"""States for the stages of the planning system (paper, section 3.2.2: a state for every component)."""

from typing import Any, Callable, Optional, Sequence

from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_sm.dispatch_client import DispatchClient, DispatchResult
from merlin_sm.pddl_text import action_text
from merlin_sm.planning_client import Planned, PlanningClient, StageError
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, MerlinState

UNSOLVABLE = "unsolvable"
TIMEOUT = "timeout"
FAILED = "failed"
CANCEL_TIMEOUT = "cancel_timeout"


class GenerateProblemState(MerlinState):
    """Has the problem written from the knowledge base."""

    def __init__(self, client: Optional[PlanningClient] = None) -> None:
        super().__init__()
        self._client = client or PlanningClient()

    def run(self, userdata: Any) -> str:
        """Generates the problem."""
        try:
            self._client.generate_problem()
        except StageError as error:
            return self.fail(str(error))
        return SUCCEEDED


class PlanState(MerlinState):
    """Has a plan made; further outcomes are unsolvable and timeout. A preempt cancels the planner."""

    def __init__(self, client: Optional[PlanningClient] = None) -> None:
        super().__init__(outcomes=[UNSOLVABLE, TIMEOUT])
        self._client = client or PlanningClient()

    def run(self, userdata: Any) -> str:
        """Plans."""
        verdict, self.reason = self._client.plan(self.interruptible)
        return {
            Planned.SOLVED: SUCCEEDED,
            Planned.UNSOLVABLE: UNSOLVABLE,
            Planned.TIMEOUT: TIMEOUT,
            Planned.CANCELLED: PREEMPTED if self.preempt_requested() else ABORTED,
        }.get(verdict, ABORTED)


class ParsePlanState(MerlinState):
    """Has the plan parsed and puts its actions, as PDDL text, into ``userdata.plan``.

    :param on_plan: called with the actions.
    """

    def __init__(
        self,
        client: Optional[PlanningClient] = None,
        on_plan: Callable[[list], None] = lambda actions: None,
    ) -> None:
        super().__init__(output_keys=["plan"])
        self._client = client or PlanningClient()
        self._on_plan = on_plan

    def run(self, userdata: Any) -> str:
        """Parses."""
        try:
            actions = self._client.parse_plan()
        except StageError as error:
            return self.fail(str(error))
        userdata.plan = [_text(action) for action in actions]
        self._on_plan(actions)
        return SUCCEEDED


class DispatchPlanState(MerlinState):
    """Has the plan dispatched. A preempt cancels the dispatch.

    Outcomes: succeeded when the goal holds, failed when an action failed or the goal does not hold (plan
    again), cancel_timeout when something did not stop in time, preempted, aborted.

    :param on_result: called with the result.
    :param plan: gives the actions that are meant, see :meth:`DispatchClient.dispatch`.
    """

    def __init__(
        self,
        client: Optional[DispatchClient] = None,
        on_result: Callable[[DispatchResult], None] = lambda result: None,
        plan: Callable[[], Sequence[ActionDispatch]] = lambda: (),
    ) -> None:
        super().__init__(outcomes=[FAILED, CANCEL_TIMEOUT])
        self._plan = plan
        self._client = client or DispatchClient()
        self._on_result = on_result

    def run(self, userdata: Any) -> str:
        """Dispatches."""
        result = self._client.dispatch(self.interruptible, self._plan())
        self._on_result(result)
        self.reason = f"{result.action}: {result.reason}" if result.action else result.reason
        if result.goal_achieved:
            return SUCCEEDED
        if result.timed_out:
            return CANCEL_TIMEOUT
        if result.cancelled and self.preempt_requested():
            return PREEMPTED
        return FAILED


def _text(action: ActionDispatch) -> str:
    return action_text(action.name, action.parameters)
