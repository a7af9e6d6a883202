# SPDX-License-Identifier: Apache-2.0
"""A goal of ``merlin/execute``, and the answer to it."""

import contextlib
import math
from typing import Callable, Iterable, List, Optional, Sequence

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import (
    ExecuteFeedback,
    ExecuteGoal,
    ExecuteResult,
    GoalDeadline,
    QueuedGoal,
    RunningAction,
    StageTime,
)
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.core.course import DISPATCH_PLAN, Course
from merlin_executor.core.outcome import StopKind, Verdict
from merlin_executor.core.request_limits import (
    ON_CLIENT_LOST,
    ON_INTERRUPT,
    check_choice,
    check_size,
    check_value,
)
from merlin_executor.core.ticket import Ticket
from merlin_executor.core.time_window import Outlook, PlanTimes, TimeWindow, outlook_running
from merlin_pddl.plan_text import PlanTextError, parse_plan
from merlin_planning.knowledge_text import parse_goal, step_text, to_pddl
from merlin_ros.actions.action_server import ServerGoal
from merlin_ros.work.passed_time import LAST


class Request(Ticket):
    """One goal of ``merlin/execute``.

    :param goal: as received.
    :param order: number of arrival.
    :param course: its way through the planning system, which has not begun.
    :param on_end: called with its id before its client is answered, unless the next life is to take it up.
    :raises PDDLSyntaxError: when a goal is not PDDL.
    :raises RequestTooLarge: beyond a limit.
    """

    def __init__(
        self,
        goal: ServerGoal,
        order: int,
        course: Course,
        on_end: Callable[[str], None] = lambda goal_id: None,
    ) -> None:
        wanted: ExecuteGoal = goal.goal
        check_choice("on_interrupt", wanted.on_interrupt, ON_INTERRUPT)
        check_choice("on_client_lost", wanted.on_client_lost, ON_CLIENT_LOST)
        super().__init__(
            order,
            wanted.priority,
            resumes=wanted.on_interrupt in (ExecuteGoal.RESUME, ExecuteGoal.NEVER),
            goes_on=wanted.survives or wanted.on_client_lost == ExecuteGoal.GO_ON,
            sender=goal.sender,
            window=TimeWindow(wanted.not_before.to_sec(), wanted.deadline.to_sec() or math.inf),
            alone=wanted.alone,
            interruptible=wanted.on_interrupt != ExecuteGoal.NEVER,
            value=check_value(wanted.value or 1.0),
        )
        self.goal = goal
        self._on_end = on_end
        tokens = [len(side.tokens) for item in wanted.items for side in (item.ineq.LHS, item.ineq.RHS)]
        check_size(wanted.goals, len(wanted.items), max(tokens, default=0))
        self.items: List[KnowledgeItem] = [item for text in wanted.goals for item in parse_goal(text)]
        self.items += wanted.items
        check_size((), len(self.items))
        self.texts = [to_pddl(item) for item in self.items]
        self.queued = rospy.Time.now()
        self.course = course
        self.plan: List[ActionDispatch] = []
        self._times = PlanTimes()
        self._kept = ""  # actions under way at a state at which they are not interrupted
        self._reported = ""  # why it is late or waits, as its client heard last
        self._fed: Optional[ExecuteFeedback] = None  # what its client heard last while it runs

    @property
    def expected_end(self) -> Optional[float]:
        """When its plan is expected to end, s of ROS time; None: not known."""
        return self._times.end(rospy.get_time())

    @property
    def outlook(self) -> Outlook:
        """What can be expected of it while it runs."""
        return outlook_running(self.window, self.expected_end)

    @property
    def text(self) -> str:
        """Its goals as PDDL text."""
        return " ".join(self.texts)

    @property
    def under_way(self) -> bool:
        """Whether its plan is being carried out."""
        return self.course.stage == DISPATCH_PLAN

    def begin(self, run: Sequence["Request"]) -> None:
        """A run begins: the first, or after another one was stopped. Its requests share one course."""
        if run[0] is self:
            self.course = Course.of([request.course for request in run])
            self.course.begin()
        else:
            self.course = run[0].course
        self._kept = ""
        self.take_plan([])

    def join(self, first: "Request") -> None:
        """Becomes part of a run whose plan is carried out."""
        first.course.take_in(self.course)
        self.course = first.course

    def take_plan(
        self,
        actions: Sequence[ActionDispatch],
        going_on: Sequence[RunningAction] = (),
        reached: Optional[float] = None,
    ) -> None:
        """Its plan is carried out from now on; none: it has no plan.

        :param going_on: those of the actions that run already; the times of the others count from their ends.
        :param reached: s from there until its own goals hold; None: at the end of the plan.
        """
        now = rospy.get_time()
        since = {action.action_id: action.dispatched.to_sec() - now for action in going_on}
        self.plan = list(actions)
        behind = max(0.0, self.end_of(going_on) - now)
        self._times.begin(
            (
                (each.action_id, since.get(each.action_id, behind + each.dispatch_time), each.duration)
                for each in actions
            ),
            now,
            None if reached is None else behind + reached,
        )

    def end_of(self, actions: Iterable[RunningAction]) -> float:
        """When the last of these actions of its plan is to end, s of ROS time; without any: zero."""
        durations = {step.action_id: step.duration for step in self.plan}
        ends = (each.dispatched.to_sec() + durations.get(each.action_id, 0.0) for each in actions)
        return max(ends, default=0.0)

    def due(self, begin: float) -> GoalDeadline:
        """Its goals with its deadline, for a plan that begins then, s of ROS time."""
        return GoalDeadline(self.texts, self.window.deadline - begin)

    @property
    def keeps(self) -> str:
        """Until when it is not interrupted; see :attr:`.Ticket.keeps`."""
        return super().keeps or (self._kept and f"{self._kept} can be interrupted")

    def runs(self, actions: Sequence[RunningAction]) -> bool:
        """Takes the actions that are under way; returns whether that changes :attr:`keeps`."""
        if self.plan:
            self._times.dispatched((action.action_id, action.dispatched.to_sec()) for action in actions)
        before = self._kept
        kept = [step_text(each) for each in actions if each.uninterruptible]
        self._kept = ", ".join(kept)
        return self._kept != before

    def accept(self) -> None:
        """Accepts the goal at the action server: the request runs."""
        self.goal.accept()

    def end(self, verdict: Verdict) -> bool:
        """Answers the client with the actionlib state that fits; False when that was done before."""
        goes_down = self.stop is not None and self.stop.kind is StopKind.SHUTDOWN
        said = verdict.reason.startswith(StopKind.SHUTDOWN.value)
        if verdict.outcome.achieved or not (goes_down or said):
            self._on_end(self.goal.id)
        elif self.goal.goal.survives and not said:  # its client knows by the reason that it goes on
            verdict = verdict._replace(reason=f"{StopKind.SHUTDOWN.value}; {verdict.reason}")
        accepted = self.goal.status not in (GoalStatus.PENDING, GoalStatus.RECALLING)
        end = getattr(self.goal, verdict.outcome.verb(accepted))
        return bool(end(self._result(verdict), verdict.reason))

    def tell(self, outlook: Outlook) -> None:
        """Tells its client, while it waits, that it can no longer be on time, or waits for a safe point."""
        reason = "; ".join(filter(None, (outlook.waits, outlook.late)))
        if reason != self._reported:
            self._reported, self._fed = reason, None
            self.goal.feedback(ExecuteFeedback(reason=reason))

    def tell_running(self, feedback: ExecuteFeedback) -> None:
        """Tells its client, while it runs, how far that is; not twice the same message."""
        if feedback != self._fed:
            self._fed = feedback
            self.goal.feedback(feedback)

    def queued_goal(self, outlook: Outlook) -> QueuedGoal:
        """Its state in the queue."""
        return QueuedGoal(
            request=self.goal.id,
            goals=self.texts,
            priority=self.priority,
            on_interrupt=self.goal.goal.on_interrupt,
            interrupted=self.interrupted,
            queued=self.queued,
            by=self.goal.goal.by,
            not_before=self.goal.goal.not_before,
            deadline=self.goal.goal.deadline,
            expected_begin=stamp(outlook.begin),
            late=outlook.late,
            expected_end=stamp(outlook.end),
            waits=outlook.waits,
            survives=self.goal.goal.survives,
            value=self.value,
        )

    def _result(self, verdict: Verdict) -> ExecuteResult:
        course = self.course
        return ExecuteResult(
            outcome=int(verdict.outcome),
            stage=course.end.stage,
            action=verdict.action,
            reason=verdict.reason,
            plan=self.plan,
            replans=course.replans,
            stage_times=[
                StageTime(stage, rospy.Duration.from_sec(seconds))
                for stage, seconds in course.stage_times.items()
            ],
        )


def stamp(at: Optional[float]) -> rospy.Time:
    """A moment that is expected, s, as a ROS time; zero: it is not known."""
    return rospy.Time.from_sec(min(at or 0.0, LAST))


def ends_by(plan: str, deadline: float) -> bool:
    """Whether a plan that begins now, as text, ends by then, s of ROS time, or has no times."""
    times, now = PlanTimes(), rospy.get_time()
    with contextlib.suppress(PlanTextError):  # the parser tells of it
        times.begin(((0, step.time, step.duration) for step in parse_plan(plan)), now)
    end = times.end(now)
    return end is None or end <= deadline


def goals_of(requests: Iterable[Request]) -> List[KnowledgeItem]:
    """The goals of requests, each once."""
    items = [item for request in requests for item in request.items]
    return list({to_pddl(item).lower(): item for item in items}.values())
