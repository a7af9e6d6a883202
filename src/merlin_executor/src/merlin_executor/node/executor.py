# SPDX-License-Identifier: Apache-2.0
"""The Executor: serves ``merlin/execute``, the most urgent requests first, equal ones in one plan.

What runs, waits and stops is decided in :mod:`merlin_executor.core.agenda`; here decisions become messages.
"""

import itertools
import threading
import traceback
from contextlib import contextmanager
from functools import partial
from typing import Dict, Iterator, Optional, Sequence, Set, Tuple

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import ExecuteAction, ExecuteFeedback, ExecuteResult, ExecutorStatus, GoalQueue

from merlin_executor.core.agenda import NOT_BEGUN, TOGETHER, Agenda
from merlin_executor.core.course import Course
from merlin_executor.core.engine import Engine
from merlin_executor.core.outcome import LONGEST_REASON, Outcome, StopKind, Verdict, crashed, end_words
from merlin_executor.core.replanning import REPLAN_WAIT, SAME_FAILURES
from merlin_executor.core.request_limits import RequestTooLarge
from merlin_executor.core.standstill import STAND_WAIT
from merlin_executor.core.ticket import OVERTAKE_LIMIT, Client
from merlin_executor.core.time_window import Outlook
from merlin_executor.goal_check import GoalError, check_goals
from merlin_executor.node.executor_sm import ExecutorSM
from merlin_executor.node.executor_stages import KNOWLEDGE_BASE
from merlin_executor.node.forecast import Forecasts
from merlin_executor.node.guard_client import GuardClient
from merlin_executor.node.joint_run import PlanningSystem
from merlin_executor.node.own_goals import OwnGoals
from merlin_executor.node.pause_services import offer_pause
from merlin_executor.node.recovery import Recovery
from merlin_executor.node.request import Request, stamp
from merlin_executor.node.robot_return import RobotReturn
from merlin_executor.node.survivors import Survivors
from merlin_pddl.text_reader import shortened
from merlin_planning.breakpoint_service import BreakpointService
from merlin_planning.dispatch_client import STUCK_AFTER, DispatchClient
from merlin_planning.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_planning.knowledge_text import PDDLSyntaxError, to_pddl
from merlin_planning.planning_client import PlanningClient
from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_ros.actions.lease import LOSE_AFTER, LeaseState
from merlin_ros.actions.lease_holder import LeaseHolder
from merlin_ros.alarms import call_later
from merlin_ros.call_scope import CallScope
from merlin_ros.deadline import Deadline
from merlin_ros.health import OK, WARN, Health
from merlin_ros.publishing import publish
from merlin_ros.ros_alarm import RosAlarm
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import CallQueue, log_failure
from merlin_sm.introspection import start_introspection
from merlin_sm.states.planning import CALL_GRACE

STATUS_WAIT = 1.0  # s of running time at start for the dispatcher's status; ROSPlan's own publish none
CHECK_LIMIT = 5.0  # s of wall time to check the goals of a request; others wait behind it
START_REST = 6.0  # s of running time at start for a plan to stop that is cancelled without a limit
CHECK_AGAIN = 1.0  # s of wall time after which the goals of a request of an earlier life are checked again
LOAD_WAIT = 60.0  # s of running time for the objects of such goals to be added to a world that was loaded
END_WAIT = 1.5  # s of wall time for the running request to end when the node does
NO_REQUEST = "no request of this id waits or runs: it has ended"
_CLIENTS = {LeaseState.SUSPENDED: Client.SILENT, LeaseState.LOST: Client.GONE}


class Executor:
    """Queues requests and runs them through :class:`ExecutorSM`, as :class:`.Agenda` decides.

    The owner of a request is its client, where that leases it. A request removes the goals that it has added.

    :param knowledge: of the planning system.
    :param planning: its stages before dispatch.
    :param dispatcher: name of its dispatcher.
    :param cancel_deadline: s of running time for a cancelled plan to stop; zero or less: no limit.
    :param max_replans: how often a failed plan is replaced.
    :param same_failures, replan_wait: as of :class:`merlin_executor.core.replanning.Replanning`.
    :param goals_file: where it notes the goals it added; empty: on the parameter server.
    :param return_wait: s of running time for a planning system that was ended, or for a robot, to return.
    :param robots: of which one whose host is gone is waited for.
    :param stand_wait: s of running time for the base to come to rest after everything has ended.
    :param stuck_after: s of running time without an action under way, after which a plan is given up at a
        dispatcher that would wait for ever; zero or less: never.
    :param overtake_limit: s of ROS time for which requests of equal priority with earlier deadlines may
        overtake one that could begin.
    :param together: how many requests one plan may be for.
    :param look_ahead: whether requests with deadlines are planned before they begin, and end as LATE as soon
        as it is proven that they are.
    :param leave_limit: as of :class:`.PlanningSystem`.
    :param owner_timeout: s of a client's silence after which its requests end.
    :raises OSError: when that file cannot be written.
    """

    def __init__(
        self,
        knowledge: KnowledgeClient,
        planning: PlanningClient,
        dispatcher: str = "rosplan_plan_dispatcher",
        cancel_deadline: float = 5.0,
        max_replans: int = 3,
        goals_file: str = "",
        return_wait: float = 8.0,
        robots: Sequence[str] = (),
        stand_wait: float = STAND_WAIT,
        stuck_after: float = STUCK_AFTER,
        overtake_limit: float = OVERTAKE_LIMIT,
        together: int = TOGETHER,
        look_ahead: bool = True,
        same_failures: int = SAME_FAILURES,
        replan_wait: float = REPLAN_WAIT,
        leave_limit: float = 2.0,
        owner_timeout: float = LOSE_AFTER,
    ) -> None:
        self._knowledge = knowledge
        self._new_course = partial(Course, max_replans, same_failures, replan_wait)
        self._publishes = threading.Event()  # set when statuses may be published
        self._own = OwnGoals(knowledge, goals_file, LeaseHolder(f"{knowledge.name}/goals/lease"))
        self._survivors = Survivors(goals_file)
        self._dispatcher = DispatchClient(
            dispatcher, knowledge.name, cancel_deadline, self._dispatch_changed, stuck_after
        )
        self._recovery = Recovery(knowledge, self._dispatcher)
        self._guard = GuardClient(knowledge.name, stand_wait, brakes=cancel_deadline > 0.0)
        system = PlanningSystem(
            knowledge,
            planning,
            self._dispatcher,
            self._recovery,
            self._guard,
            RobotReturn(knowledge, robots, return_wait),
            return_wait,
            look_ahead,
            leave_limit,
        )
        self._machine = ExecutorSM(system, self._own, self._publish_status, lambda: self._engine)
        self._server = ActionServer(
            "merlin/execute",
            ExecuteAction,
            self._receive,
            self._cancel,
            self._owner,
            _ended_by_server,
            owner_timeout,
        )
        self._alarm = RosAlarm(lambda: self._engine.look(), "request times")
        self._engine: Engine[Request] = Engine(
            self._machine,
            self._publish_status,
            self._publish_queue,
            self._ended,
            self._log,
            Agenda(rospy.get_time, overtake_limit, together),
            self._alarm.set,
        )
        self._forecasts = Forecasts(self._engine, planning, self._dispatcher) if look_ahead else None
        self._last = "", False  # which request ended last, and how; whether that was for software
        self._lock = threading.Lock()  # guards the fields below down to _loading
        self._unread: Set[str] = set()  # goals that are not requests yet
        self._checks: Dict[str, CallScope] = {}  # goal -> the calls that check it
        self._aside: Dict[str, Tuple[Request, str]] = {}  # of an earlier life, to be checked again, and why
        self._unchecked = ""  # why the knowledge base did not say anything when such a request was checked
        self._comes_again = False  # whether those are about to be checked again
        self._loading = Deadline(LOAD_WAIT)
        self._again = CallQueue("requests of an earlier life")
        self._order = itertools.count()
        self._publishing = threading.Lock()  # keeps statuses and queues in order; guards the fields below
        self._expected_end: Optional[float] = None  # of the running request, as the queue showed last
        self._urgent_waits = ""  # of the last status
        self._queued = True  # whether the last queue was not empty, or there was none

    def start(self) -> None:
        """Puts right what a killed Executor left and begins to serve."""
        self._dispatcher.wait_status(STATUS_WAIT)
        self._recover()
        self._status_publisher = rospy.Publisher("merlin/status", ExecutorStatus, latch=True, queue_size=10)
        self._queue_publisher = rospy.Publisher("merlin/queue", GoalQueue, latch=True, queue_size=10)
        self._introspection = start_introspection("EXECUTOR", self._machine)
        self._publishes.set()
        self._publish_status()
        self._publish_queue()
        self._pauses = offer_pause(self._pause)
        self._points = BreakpointService(self._engine.agenda.breakpoints, self._breakpoints_changed).offer(
            "merlin/breakpoints"
        )
        self._guard.follow(self._hold_changed)
        self._engine.start()
        self._server.start(self._survivors.left())

    def shutdown(self) -> None:
        """Cancels what runs, answers what waits, and stops serving."""
        with self._lock:
            self._aside.clear()  # the next life checks those
        self._engine.shutdown(END_WAIT)
        self._alarm.shutdown()
        self._server.shutdown()
        self._introspection.stop()

    def health(self) -> Health:
        """What it does; a warning when the last request failed because of software."""
        running = [text for request in self._engine.agenda.together for text in request.texts]
        doing = f"running {', '.join(running)}" if running else "idle"
        reason, ill = self._last
        values = {"waiting requests": len(self._engine.waiting), "last request": reason}
        return Health(WARN, f"{doing}; last: {reason}", values) if ill else Health(OK, doing, values)

    def _pause(self, paused: bool) -> None:
        self._engine.decide(lambda agenda: agenda.pause(paused))
        self._publish_status()

    def _hold_changed(self) -> None:
        self._engine.decide(lambda agenda: agenda.hold(bool(self._guard.hold)))
        self._publish_status()

    def _breakpoints_changed(self) -> None:
        self._engine.look()
        self._publish_status()

    def _dispatch_changed(self) -> None:
        if self._publishes.is_set():
            self._publish_status()
            self._machine.dispatch_changed()

    # --- events, in threads of the action server ----------------------------------------------------------

    def _receive(self, goal: ServerGoal, known: Optional[Request] = None) -> None:
        with self._lock:
            self._unread.add(goal.id)
        try:
            self._read(known or Request(goal, next(self._order), self._new_course(), self._survivors.drop))
        except (PDDLSyntaxError, RequestTooLarge) as error:
            self._refuse(goal, str(error))
        except OSError as error:
            self._refuse(goal, f"the request could not be noted for the next life of the executor: {error}")
        except BaseException as error:  # the client gets its answer, whatever it sent
            log_failure("executor")
            self._refuse(goal, f"the request could not be read: {crashed(error).reason}")
        finally:
            with self._lock:
                self._unread.discard(goal.id)

    def _read(self, request: Request) -> None:
        goal = request.goal
        noted = self._survivors.knows(goal.id)
        with self._lock:
            why = self._unchecked if noted and not goal.cancel_requested else ""
        if why:
            self._set_aside(request, why)
            return
        try:
            if goal.goal.survives and not request.items:
                raise GoalError(StopKind.SHUTDOWN.value if noted else NO_REQUEST)
            with self._checking(goal):
                check_goals(request.items, self._knowledge)
            request.texts = [to_pddl(item) for item in request.items]  # the arguments are in order now
            again = goal.goal.survives and self._survivors.keep(goal)
        except (GoalError, ServiceError) as error:
            unchecked = isinstance(error, ServiceError)
            why = f"the goals could not be checked: {KNOWLEDGE_BASE}: {error}" if unchecked else str(error)
            with self._lock:
                if unchecked:
                    self._loading = Deadline(LOAD_WAIT)
                    self._unchecked = why if noted else self._unchecked
                over = self._loading.expired or goal.cancel_requested
            if over or not noted or not request.items:
                self._refuse(goal, why)
            else:
                rospy.logwarn_throttle_identical(LOAD_WAIT, f"a request of an earlier executor waits: {why}")
                self._set_aside(request, why)
        else:
            with self._lock:
                self._aside.pop(goal.id, None)
            self._engine.decide(lambda agenda: agenda.receive(request, goal.cancel_requested, again))

    def _set_aside(self, request: Request, why: str) -> None:
        """A request of an earlier life is checked again later: what it is about may still be loaded."""
        with self._lock:
            before = self._aside.get(request.goal.id)
            self._aside[request.goal.id] = request, why
            self._come_again()
        if before != (request, why):
            self._publish_queue()

    def _come_again(self) -> None:
        """Called with the lock held."""
        if self._aside and not self._comes_again:
            self._comes_again = True
            call_later(CHECK_AGAIN, lambda: self._again.put(self._check_again))

    def _check_again(self) -> None:
        """As long as the knowledge base does not answer, only the first one is checked."""
        with self._lock:
            aside, self._unchecked = list(self._aside.items()), ""
        for goal_id, (request, _) in aside:
            if goal_id in self._aside:  # it was not taken back meanwhile
                self._receive(request.goal, request)
        with self._lock:
            self._comes_again = False
            self._come_again()

    @contextmanager
    def _checking(self, goal: ServerGoal) -> Iterator[None]:
        """While the goals of a request are checked; a cancel ends that."""
        with CallScope(CHECK_LIMIT) as calls:
            with self._lock:
                self._checks[goal.id] = calls
            if goal.cancel_requested:
                calls.end(CALL_GRACE)
            try:
                yield
            finally:
                with self._lock:
                    del self._checks[goal.id]

    def _cancel(self, goal: ServerGoal) -> None:
        with self._lock:
            calls = self._checks.get(goal.id)
            aside = goal.id in self._aside
        if aside:
            self._refuse(goal, "its goals could not be checked yet")
        if calls is not None:
            calls.end(CALL_GRACE)
        self._engine.decide_on(
            lambda request: request.goal is goal, lambda agenda, request: agenda.cancel(request)
        )

    def _owner(self, goal: ServerGoal, state: LeaseState, reason: str) -> Optional[bool]:
        with self._lock:
            if goal.id in self._unread:
                return False  # what it says of its client is not read yet; the server asks again then
        client = _CLIENTS.get(state, Client.ALIVE)
        found = self._engine.decide_on(
            lambda request: request.goal is goal,
            lambda agenda, request: agenda.client(request, client, reason),
        )
        return found is None or not found.goes_on

    def _refuse(self, goal: ServerGoal, reason: str) -> None:
        named = bool(goal.goal.goals or goal.goal.items)
        if named:  # without goals its client looks for the noted one
            self._survivors.drop(goal.id)
            with self._lock:
                aside = self._aside.pop(goal.id, None)
            if aside is not None:
                self._publish_queue()
        # A client may send names without end; the log, and all that listen to it, need not have them.
        reason = shortened(reason, LONGEST_REASON)
        outcome, end = Outcome.REFUSED, goal.reject
        if named and goal.cancel_requested:
            outcome, end, reason = Outcome.CANCELLED, goal.cancelled, f"{NOT_BEGUN}; {reason}"
        rospy.logwarn(f"{outcome.name}: {reason}")
        end(ExecuteResult(outcome=int(outcome), reason=reason), reason)

    # --- what is published ---------------------------------------------------------------------------------

    def _ended(self, request: Request, verdict: Verdict) -> None:
        if self._forecasts is not None:
            self._forecasts.forget(verdict.outcome.achieved)
        self._last = end_words(request.texts, verdict), verdict.outcome.of_software

    def _log(self, requests: Sequence[Request], verdict: Verdict, error: Optional[BaseException]) -> None:
        """Behind the answers: a line of a log costs half a millisecond."""
        if error is not None:
            lines = traceback.format_exception(type(error), error, error.__traceback__)
            rospy.logerr(f"executor: {''.join(lines)}")
        rospy.loginfo(end_words([text for request in requests for text in request.texts], verdict))

    def _publish_status(self) -> None:
        with self._publishing:
            together = self._engine.agenda.together
            request = together[0] if together else None
            freed = False  # whether something more urgent may interrupt it now, or no longer
            status = ExecutorStatus(state=ExecutorStatus.IDLE, reason=self._last[0])
            status.paused = self._engine.agenda.paused
            status.waits = self._guard.hold
            hold = self._dispatcher.hold
            status.breakpoints = [*self._engine.agenda.breakpoints.texts, *hold.breakpoints]
            status.held = self._engine.agenda.breakpoints.held or hold.held
            status.header.stamp = rospy.Time.now()
            if request is not None:
                ends = any(each.stop and each.stop.kind is not StopKind.JOINED for each in together)
                stops = ends and self._engine.agenda.stopping
                status.state = ExecutorStatus.CANCELLING if stops else ExecutorStatus.RUNNING
                status.request = request.goal.id
                status.goals = request.texts
                status.priority = request.priority
                status.by = request.goal.goal.by
                status.stage = request.course.stage
                status.running = self._dispatcher.running
                status.steps_done = self._dispatcher.steps_done if request.plan else 0
                status.steps_total = len(request.plan)
                status.replans = request.course.replans
                status.reason = request.course.replan_reason
                changes = [each.runs(status.running) for each in together]
                freed = any(changes)
                if any(each.keeps for each in together):
                    status.urgent_waits = _urgent_waits(together, self._engine.outlooks())
                outlook = request.outlook
                status.deadline = request.goal.goal.deadline
                status.expected_end = stamp(outlook.end)
                status.late = outlook.late
                status.together = [each.queued_goal(each.outlook) for each in together[1:]]
                for each, late in zip(together, (outlook.late, *(each.late for each in status.together))):
                    feedback = ExecuteFeedback(
                        stage=status.stage,
                        running=status.running,
                        steps_done=status.steps_done,
                        steps_total=status.steps_total,
                        reason="; ".join(filter(None, (status.reason, late))),
                    )
                    if each.stop is None or not each.stop.is_final:  # otherwise its client waits for the end
                        each.tell_running(feedback)
            self._urgent_waits = status.urgent_waits
            publish(self._status_publisher, status)
            shifted = request is not None and request.expected_end != self._expected_end
        if (freed or shifted) and self._engine.waiting:
            self._engine.look()

    def _publish_queue(self) -> None:
        with self._publishing:
            together = self._engine.agenda.together
            self._expected_end = together[0].expected_end if together else None
            outlooks = self._engine.outlooks()
            changed = bool(together) and _urgent_waits(together, outlooks) != self._urgent_waits
            for request, outlook in outlooks:
                request.tell(outlook)
            with self._lock:
                outlooks += [(request, Outlook(waits=why)) for request, why in self._aside.values()]
            message = GoalQueue(requests=[request.queued_goal(outlook) for request, outlook in outlooks])
            message.header.stamp = rospy.Time.now()
            if message.requests or self._queued:  # cancels of many at once need not say that nothing waits
                publish(self._queue_publisher, message)
            self._queued = bool(message.requests)
        if changed:
            self._publish_status()
        if self._forecasts is not None:
            self._forecasts.look()

    # --- an earlier process of this node --------------------------------------------------------------------

    def _recover(self) -> None:
        """Ends what an Executor that was killed has left: its dispatch, its executions, its goals."""
        try:
            trouble = self._recovery.rest(lambda interrupt: None, START_REST)
            if trouble:
                rospy.logerr(f"what an earlier executor left is not settled yet: {trouble}")
            texts = self._own.remove_left()
        except (KnowledgeError, ServiceError, OSError) as error:
            rospy.logerr(f"what an earlier executor left stays in the knowledge base: {error}")
            return
        if texts:
            rospy.logwarn(f"removed the goals that an earlier executor left: {', '.join(texts)}")


def _urgent_waits(together: Sequence[Request], outlooks: Sequence[Tuple[Request, Outlook]]) -> str:
    """Why a request waits that is more urgent than those that run; empty: it does not wait for them."""
    if not any(each.keeps for each in together):
        return ""
    urgent = [outlook.waits for each, outlook in outlooks if each.priority > together[0].priority]
    return next(filter(None, urgent), "")


def _ended_by_server(status: GoalStatus) -> ExecuteResult:
    """The result of a goal that the action server has ended itself; an empty one would say SUCCEEDED."""
    cancelled = status.status in (GoalStatus.RECALLED, GoalStatus.PREEMPTED)
    outcome = Outcome.CANCELLED if cancelled else Outcome.INTERNAL
    return ExecuteResult(outcome=int(outcome), reason=status.text)
