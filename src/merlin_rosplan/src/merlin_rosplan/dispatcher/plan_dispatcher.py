# SPDX-License-Identifier: Apache-2.0
"""What both plan dispatchers of ROSPlan share, over the core in :mod:`merlin_rosplan.dispatch.dispatch`."""

import dataclasses
import functools
import threading
from typing import TYPE_CHECKING, Any, FrozenSet, Optional, Tuple, Type

import rospy
from merlin_msgs.srv import Breakpoints as BreakpointsSrv
from merlin_msgs.srv import ExchangePlan, ExchangePlanRequest, ExchangePlanResponse
from rosplan_dispatch_msgs.msg import (
    ActionFeedback,
    CompletePlan,
    NonBlockingDispatchAction,
    NonBlockingDispatchFeedback,
    NonBlockingDispatchResult,
)
from rosplan_dispatch_msgs.srv import DispatchService, DispatchServiceRequest, DispatchServiceResponse
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from merlin_pddl.breakpoints import Breakpoints
from merlin_planning.action_messages import OWN_MARK
from merlin_planning.breakpoint_service import BreakpointService
from merlin_planning.dispatch_progress import NO, STOPPED, unmet_reason
from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_ros.actions.lease import LEASED, LOSE_AFTER, SUSPEND_AFTER, LeaseState
from merlin_ros.actions.peers import sender_of
from merlin_ros.alarms import wait_ticks
from merlin_ros.deadline import Deadline, limit
from merlin_ros.health import OK, WARN, Health
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.master.namesake import living_namesake
from merlin_ros.ports.service_server import after_answer
from merlin_ros.work.threads import log_failure, start_thread
from merlin_ros.work.work_book import Policy, WorkBook
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchLimits,
    DispatchReport,
    DispatchState,
    Event,
    Exchange,
    Feedback,
    FeedbackStatus,
    KnowledgeChanged,
    PlanKnowledgeError,
    RestWatch,
    Tick,
    together,
)
from merlin_rosplan.dispatch.dispatch_schedule import Ongoing, PlanError
from merlin_rosplan.dispatcher.dispatch_settler import DispatchSettler
from merlin_rosplan.dispatcher.dispatch_topics import SHUTDOWN_DEADLINE, DispatchTopics, KnowledgeEvents
from merlin_rosplan.transport.component import Component
from merlin_rosplan.transport.handover import Handover

if TYPE_CHECKING:  # what carries out a plan is imported when the node serves
    from merlin_rosplan.dispatch.dispatch import PlanDispatch
    from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
    from merlin_rosplan.dispatcher.plan_knowledge import PlanKnowledge

SCOPE = "rosplan_plan_dispatcher"
IN_FLIGHT = 0.5  # s for which a call waits for a plan that may be on its way
EXCHANGE_LIMIT = 5.0  # s for a dispatch to take another plan; and for it to go on with that one
NOTHING = Ongoing()
SLACK = 1.0  # s beyond the cancel deadline for the dispatch of a lost owner to end


class DispatchRefused(rospy.ServiceException):
    """The plan of another client is being dispatched."""


class _Turn:
    """A dispatch of one client, which runs or waits for its turn.

    :param client: the node that it is for; empty: not known.
    :param goal: None: a call of the service.
    """

    def __init__(self, client: str = "", goal: Optional[ServerGoal] = None) -> None:
        self.client = client
        self.goal = goal
        self.dispatch: Optional[PlanDispatch] = None
        self.stopped = False

    @property
    def ends(self) -> bool:
        """Whether it has to stop, or its end is published: another one may wait for its turn."""
        return self.stopped or (self.goal is not None and self.goal.cancel_requested)

    def has_owner(self) -> bool:
        """Whether its client lives; one that is not known, or hangs, does.

        The action server watches a client that leases. Any other one is asked, which takes 2 s at most.
        """
        if not self.client or (self.goal is not None and self.goal.id.endswith(LEASED)):
            return True
        try:
            return living_namesake(self.client, bounded_master()) is not None
        except ERRORS:
            return True


IDLE = _Turn()


class PlanDispatcher(Component):
    """Base of both dispatchers: one dispatch at a time, whose owner is the client that leases its goal.

    The next one waits while the first one ends, is refused while its owner lives, and else stops it. A stop
    cancels the actions; those that do not answer in time are named, and settled in the knowledge base.

    Services ``dispatch_plan``, ``cancel_dispatch``, ``exchange_plan``, ``breakpoints``; action server
    ``dispatch_plan_action``; topics ``action_dispatch``, ``dispatch_status`` and what the subclass adds.
    """

    plan_class: Type[Any] = CompletePlan
    publishes_feedback = True

    def __init__(self, scope: str = SCOPE) -> None:
        super().__init__(scope)
        self._state = threading.Condition()  # guards the fields down to _missed
        self._plan: Optional[Any] = None
        self._fresh = False
        self._failure = ""  # of the last dispatch
        self._turns: WorkBook[_Turn] = WorkBook(Policy.IN_TURN)
        self._owed = 0  # goals that have no answer yet
        self._missed: Optional[FrozenSet[str]] = frozenset()  # names changed since the last one; None: any
        self._watches_rest = self.flag("watch_rest", True)
        self._limits = DispatchLimits(
            acknowledge=limit(self.number("ack_timeout", 2.0, 0.0)),
            accept=limit(self.number("accept_timeout", 10.0, 0.0)),
            liveness=limit(self.number("liveness_timeout", 5.0, 0.0)),
            cancel=limit(self.number("cancel_deadline", 5.0)),
            over_all_grace=self.number("over_all_grace", 1.0, 0.0),
            settle=self.number("settle_time", 2.0, 0.0),
        )
        self._allow_redispatch = self.flag("allow_redispatch", False)
        self._breakpoints = Breakpoints()
        self._topics = DispatchTopics(
            self,
            lambda: self._knowledge,
            self.publishes_feedback,
            functools.partial(self._put, Tick()),
            self._forward,
            self.progressed,
            self._breakpoints,
        )
        self._settler = self.own(
            DispatchSettler(self.knowledge_base, self._topics.seconds_silent, self._limits.liveness)
        )
        feedback_topic = str(self.param("action_feedback_topic", "action_feedback"))
        answers = self.subscriber(feedback_topic, ActionFeedback, self._receive_feedback)  # none is dropped
        self._took = functools.partial(self._topics.taken, topic=answers)
        KnowledgeEvents(self, self._put)
        self._plan_topic = self.resolve(str(self.param("plan_topic", "complete_plan")))
        self._plans = self.own(Handover.receiver(self._plan_topic, self._receive_plan))
        self.subscriber(self._plan_topic, self.plan_class, self._plans.from_topic, queue_size=1)

        self._server = self.own(
            ActionServer(
                self.resolve("dispatch_plan_action"),
                NonBlockingDispatchAction,
                self._accept,
                self._cancel_goal,
                self._goal_owner_changed,
                lose_owner_after=self.number("owner_timeout", LOSE_AFTER, SUSPEND_AFTER),
            )
        )
        self._server.start()
        self.service("dispatch_plan", DispatchService, self._serve)
        self.service("cancel_dispatch", Empty, self._serve_cancel)
        self.service("exchange_plan", ExchangePlan, self._serve_exchange)
        breakpoints = BreakpointService(self._breakpoints, self._breakpoints_changed)
        self.service("breakpoints", BreakpointsSrv, breakpoints.answer)

    def prepare(self) -> None:
        """Imports what the first dispatch needs."""
        from merlin_rosplan.dispatch import dispatch  # noqa: F401
        from merlin_rosplan.rest import rest_watch  # noqa: F401

        _ = self._knowledge

    @functools.cached_property
    def _knowledge(self) -> "PlanKnowledge":
        from merlin_rosplan.dispatcher.plan_knowledge import PlanKnowledge

        return PlanKnowledge(self.knowledge_base)

    def on_shutdown(self) -> None:
        """Cancels the dispatch, and waits a moment for its end and the answer: the server would abort it."""
        with self._state:
            dispatch = self._turn.dispatch
            self._state.notify_all()
        if dispatch is not None:
            dispatch.cancel("the dispatcher ends")
        wait_ticks(self._has_answered, SHUTDOWN_DEADLINE)

    def _has_answered(self, seconds: float) -> bool:
        with self._state:
            return self._state.wait_for(lambda: self._turns.idle and not self._owed, seconds)

    def health(self) -> Health:
        """Whether a plan is dispatched; a warning with the reason when the last one failed."""
        with self._state:
            busy, failure = not self._turns.idle, self._failure
        if failure and not busy:
            return Health(WARN, f"the last dispatch failed: {failure}")
        return Health(OK, "dispatching" if busy else "idle")

    # --- for subclasses ---------------------------------------------------------------------------

    def make_schedule(self, plan: Any, ongoing: Ongoing = NOTHING) -> "GraphSchedule":
        """The schedule of a plan message.

        :param ongoing: the actions that run meanwhile. The schedule contains those that go on.
        :raises PlanError: the plan cannot be dispatched.
        :raises DispatchError: it cannot be found out what has to wait for what runs.
        """
        raise NotImplementedError

    def received(self, plan: Any) -> None:
        """A plan has come; for subclasses that show it."""

    def progressed(self) -> None:
        """A dispatch has made a step; for subclasses that show it."""

    # --- services and action ------------------------------------------------------------------------

    def _serve(self, request: DispatchServiceRequest) -> DispatchServiceResponse:
        report = self._run(self._arrive(_Turn(sender_of(request))))
        return DispatchServiceResponse(success=report.success, goal_achieved=report.goal_achieved)

    def _serve_cancel(self, _: EmptyRequest) -> EmptyResponse:
        with self._state:
            turn = self._turn
        if turn is IDLE:
            rospy.loginfo("%s: cancel_dispatch: nothing is dispatched", self.scope)
        else:
            # As in ROSPlan the answer is not news of the end: that comes from dispatch_plan.
            self._stop(turn, "cancelled by cancel_dispatch")
        return EmptyResponse()

    def _serve_exchange(self, request: ExchangePlanRequest) -> ExchangePlanResponse:
        with self._state:
            dispatch, goal = self._turn.dispatch, self._turn.goal
        if dispatch is None or goal is None or (goal.id, goal.sender) != (request.goal, sender_of(request)):
            return ExchangePlanResponse("the dispatcher carries out no plan for this goal of this client")
        try:
            plan = self._take_plan()
        except PlanError as error:
            return ExchangePlanResponse(str(error))

        def make(ongoing: Ongoing) -> "Tuple[GraphSchedule, Optional[RestWatch]]":
            schedule = self.make_schedule(plan, ongoing)
            return schedule, self._watch(schedule, None)

        wish = Exchange(frozenset(request.keep), make, frozenset(request.known))
        dispatch.exchange(wish)
        if not Deadline(EXCHANGE_LIMIT).wait_event(wish.ended) and wish.take_back():
            return ExchangePlanResponse(f"the dispatch took no other plan within {EXCHANGE_LIMIT:g} s")
        if not Deadline(EXCHANGE_LIMIT).wait_event(wish.ended):
            return ExchangePlanResponse("the dispatch does not say whether it goes on with the other plan")
        refused = f"the plan is not exchanged: {wish.refusal}" if wish.refusal else ""
        rospy.loginfo("%s: %s", self.scope, refused or "goes on with another plan")
        return ExchangePlanResponse(refused)

    def _watch(self, schedule: "GraphSchedule", missed: Optional[FrozenSet[str]]) -> Optional[RestWatch]:
        from merlin_rosplan.rest.rest_watch import PlanWatch

        return PlanWatch(schedule, self._topics, missed) if self._watches_rest else None

    def _accept(self, goal: ServerGoal) -> None:
        turn = self._arrive(_Turn(goal.sender, goal))
        try:
            start_thread(f"dispatch {self.scope}", self._run_goal, turn, goal)
        except RuntimeError:  # the server answers
            self._leave(turn, 1)
            raise

    def _run_goal(self, turn: _Turn, goal: ServerGoal) -> None:
        try:
            report = self._run(turn)
            text = report.reason or "every action succeeded"
            result = NonBlockingDispatchResult(success=report.success, goal_achieved=report.goal_achieved)
            if report.success:
                goal.succeed(result, text)
            elif report.state == DispatchState.CANCELLED:
                goal.cancelled(result, text)
            else:
                goal.abort(result, text)
        except DispatchRefused as refused:
            goal.reject(NonBlockingDispatchResult(), str(refused))
        except Exception:  # the client gets its answer all the same
            goal.abort(NonBlockingDispatchResult(), log_failure(self.scope))
        finally:
            self._leave(turn, 1)

    def _cancel_goal(self, goal: ServerGoal) -> None:
        with self._state:
            turn = self._turn
        if turn.goal is goal:
            lost = goal.cancel_reason != "cancelled"
            why = f"its owner is gone: {goal.cancel_reason}"
            self._stop(turn, why if lost else "cancelled through dispatch_plan_action")

    def _goal_owner_changed(self, goal: ServerGoal, state: LeaseState, reason: str) -> None:
        """No action starts while the owner is silent. What runs is suspended by the server, which also
        cancels the goal of a lost owner."""
        with self._state:
            dispatch = self._turn.dispatch if self._turn.goal is goal else None
        if dispatch is None or state is LeaseState.LOST:
            return
        dispatch.suspend(state is LeaseState.SUSPENDED)
        if state is LeaseState.SUSPENDED:
            rospy.logwarn("%s: no further action starts: %s", self.scope, reason)

    # --- one dispatch -------------------------------------------------------------------------------

    @property
    def _turn(self) -> _Turn:
        """The one that runs; read with the lock held."""
        return next(iter(self._turns.running), IDLE)

    def _arrive(self, turn: _Turn) -> _Turn:
        with self._state:
            self._turns.arrive(turn)
            self._owed += turn.goal is not None
        return turn

    def _stop(self, turn: _Turn, reason: str) -> None:
        with self._state:
            dispatch, turn.stopped = turn.dispatch, True
        if dispatch is not None:  # else it is cancelled when there is one
            dispatch.cancel(reason)

    def _comes(self, turn: _Turn) -> bool:
        """Whether the turn of a client that has arrived is there; else waits for the end of the one before.

        The dispatch of a dead client is cancelled for it.

        :raises DispatchRefused: the client before it lives, or its dispatch does not end.
        """
        with self._state:
            first = self._turn
        if first is turn:
            return True
        stays = not first.ends and first.has_owner()
        if not (stays or first.ends):
            self._stop(first, f"its owner {first.client} is gone")
        patience = self._limits.cancel
        deadline = Deadline(0.0 if stays else None if patience is None else patience + SLACK)
        with self._state:
            deadline.wait(self._state, lambda: self._turn is not first or self.closed)
            if self._turn is first:
                owner = f"for {first.client or 'a client that is not known'}"
                why = owner if stays else "and does not end"
                raise DispatchRefused(f"a plan is being dispatched already, {why}")
        return False

    def _run(self, turn: _Turn) -> DispatchReport:
        """Dispatches the plan received last when the turn of a client has come.

        :raises DispatchRefused: it does not come.
        """
        try:
            while not self._comes(turn):
                pass
            try:
                if turn.goal is not None:
                    turn.goal.accept()
                report = self._run_plan(turn)
            except PlanError as error:
                report = DispatchReport(DispatchState.FAILED, str(error))
            except Exception:  # the caller gets its answer, and the dispatcher continues
                report = DispatchReport(DispatchState.FAILED, log_failure(self.scope))
            judged = self._judged(report)
            with self._state:
                turn.stopped = True
                self._failure = report.reason if report.state == DispatchState.FAILED else ""
            self._topics.report_status(judged)
            after_answer(lambda: self._log(report, judged))
        finally:
            self._leave(turn)
        return judged

    def _leave(self, turn: _Turn, answered: int = 0) -> None:
        with self._state:
            self._owed -= answered
            self._turns.cancel(turn, "refused")  # where it waits
            self._turns.end(turn)
            self._state.notify_all()

    def _log(self, report: DispatchReport, judged: DispatchReport) -> None:
        log = rospy.logerr if report.state == DispatchState.FAILED else rospy.loginfo
        log("%s: %s: %s", self.scope, report.state.name, report.reason)
        if report.success and judged.reason:
            now = "of all goals that the knowledge base has now"  # its owner knows which are of the plan
            rospy.loginfo("%s: every action succeeded; %s: %s", self.scope, now, judged.reason)

    def _run_plan(self, turn: _Turn) -> DispatchReport:
        from merlin_rosplan.dispatch.dispatch import PlanDispatch

        schedule = self.make_schedule(self._take_plan())
        goal = turn.goal
        with self._state:
            missed, self._missed = self._missed, frozenset()
        dispatch = PlanDispatch(
            schedule,
            self._topics,
            self._limits,
            self._topics.begin(goal.id if goal is not None else ""),
            breakpoints=self._breakpoints,
            watch=self._watch(schedule, missed),
        )
        with self._state:
            turn.dispatch = dispatch
            missed, self._missed = self._missed, frozenset()
        dispatch.put(KnowledgeChanged(missed))  # while it was made
        if self.closed or turn.ends:  # a cancel before this point found no dispatch to stop
            dispatch.cancel("cancelled before it began")
        if goal is not None:
            self._server.tell_owner(goal)  # it may have fallen silent before
        try:
            return dispatch.run()
        finally:
            self._settler.settle(dispatch.plan_id, self._topics.unanswered())

    def _take_plan(self) -> Any:
        self._plans.catch_up()
        with self._state:
            self._state.wait_for(lambda: self._fresh or self.closed, timeout=IN_FLIGHT)
            if self._plan is None:
                raise PlanError(f"there is no plan: nothing was received on {self._plan_topic}")
            if not self._fresh and not self._allow_redispatch:
                raise PlanError("there is no new plan: the last one was dispatched already")
            self._fresh = False
            return self._plan

    def _judged(self, report: DispatchReport) -> DispatchReport:
        """A report whose success is checked against the goals; its reason says why it does not count."""
        try:
            unmet = tuple(self._knowledge.unmet_goals())
            reason = unmet_reason(unmet) if unmet else ""
        except PlanKnowledgeError as error:
            unmet, reason = (), f"whether the goals hold is not known: {error}"
        except Exception:  # a goal of another knowledge base may be what no text can say
            unmet, reason = (), f"whether the goals hold is not known: {log_failure(self.scope)}"
        return dataclasses.replace(
            report,
            reason=reason if report.success else report.reason,
            goal_achieved=not reason,
            unmet_goals=unmet,
        )

    # --- what arrives -------------------------------------------------------------------------------

    def _receive_plan(self, plan: Any) -> None:
        with self._state:
            self._plan, self._fresh = plan, True
            self._state.notify_all()
        self.received(plan)

    def _receive_feedback(self, message: ActionFeedback) -> None:
        if any(entry.key == OWN_MARK for entry in message.information):
            return
        with self._state:
            dispatch, goal = self._turn.dispatch, self._turn.goal
        if dispatch is None:
            return
        if message.plan_id in (0, dispatch.plan_id):
            if message.status in (FeedbackStatus.SUCCEEDED, FeedbackStatus.FAILED):
                self._topics.answered(message.action_id)
            elif message.status == FeedbackStatus.ENABLED:
                self._took(message)
        said = {entry.key: entry.value for entry in reversed(message.information)}
        if goal is not None:  # first: the event may end the goal
            goal.feedback(NonBlockingDispatchFeedback(feedback=message))
        why = said.get("reason", ""), said.get("robot", ""), said.get(STOPPED, "").lower() == NO
        dispatch.put(Feedback(message.action_id, message.status, message.plan_id, *why))

    def _forward(self, message: ActionFeedback) -> None:
        with self._state:
            goal = self._turn.goal
        if goal is not None:
            goal.feedback(NonBlockingDispatchFeedback(feedback=message))

    def _breakpoints_changed(self) -> None:
        self._topics.repeat_status()
        self._put(Tick())

    def _put(self, event: Event) -> None:
        """Passes an event to the dispatch that runs; the next one gets what it would miss."""
        with self._state:
            dispatch = self._turn.dispatch
            if dispatch is None and isinstance(event, KnowledgeChanged):
                self._missed = together(self._missed, event.names)
        if dispatch is not None:
            dispatch.put(event)
