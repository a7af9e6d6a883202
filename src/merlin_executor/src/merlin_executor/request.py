"""What the Executor is asked to do, and what it has to say about it."""

from enum import Enum
from typing import Dict, List, Optional, Sequence, Tuple

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import ExecuteResult, QueuedGoal, StageTime
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_sm.action_server import ServerGoal
from merlin_sm.pddl_text import parse_goal, to_pddl


class Stop(Enum):
    """Why a running request has to stop."""

    CANCELLED = "cancelled by its client"
    INTERRUPTED = "interrupted by a more urgent request"
    SHUTDOWN = "the executor shuts down"


class Request:
    """One goal of ``merlin/execute``.

    :param goal: as received.
    :param order: number of arrival; equal priorities run in this order.
    :raises PDDLSyntaxError: when a goal is no PDDL.
    """

    def __init__(self, goal: ServerGoal, order: int) -> None:
        self.goal = goal
        self.order = order
        texts = goal.goal.goals
        self.items: List[KnowledgeItem] = [item for text in texts for item in parse_goal(text)]
        self.items += goal.goal.items
        self.texts = [to_pddl(item) for item in self.items]
        self.priority: int = goal.goal.priority
        self.on_interrupt: int = goal.goal.on_interrupt
        self.interrupted = False
        self.queued = rospy.Time.now()
        self.stop: Optional[Stop] = None
        self.stage = ""
        self.plan: List[ActionDispatch] = []
        self.replans = 0
        self.action = ""
        self.stage_times: Dict[str, float] = {}

    @property
    def urgency(self) -> Tuple[int, int]:
        """Sorts requests: the most urgent, then the oldest, first."""
        return -self.priority, self.order

    def begin(self) -> None:
        """Forgets an earlier, interrupted run."""
        self.stop = None
        self.plan = []
        self.action = ""

    def result(self, outcome: int, reason: str) -> ExecuteResult:
        """The result message."""
        return ExecuteResult(
            outcome=outcome,
            stage=self.stage,
            action=self.action,
            reason=reason,
            plan=self.plan,
            replans=self.replans,
            stage_times=[
                StageTime(stage, rospy.Duration.from_sec(seconds))
                for stage, seconds in self.stage_times.items()
            ],
        )

    def end(self, outcome: int, reason: str) -> None:
        """Answers the client, with the actionlib state that fits the outcome."""
        result = self.result(outcome, reason)
        if outcome in (ExecuteResult.SUCCEEDED, ExecuteResult.ALREADY_TRUE):
            self.goal.succeed(result, reason)
        elif outcome in (ExecuteResult.CANCELLED, ExecuteResult.DROPPED):
            self.goal.cancelled(result, reason)
        elif outcome == ExecuteResult.REFUSED and self.goal.status in (
            GoalStatus.PENDING,
            GoalStatus.RECALLING,
        ):
            self.goal.reject(result, reason)
        else:
            self.goal.abort(result, reason)

    def queued_goal(self) -> QueuedGoal:
        """How it stands in the queue."""
        return QueuedGoal(
            request=self.goal.id,
            goals=self.texts,
            priority=self.priority,
            on_interrupt=self.on_interrupt,
            interrupted=self.interrupted,
            queued=self.queued,
        )


def sorted_requests(requests: Sequence[Request]) -> List[Request]:
    """In the order in which they will run."""
    return sorted(requests, key=lambda request: request.urgency)
