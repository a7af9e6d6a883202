"""The Executor: serves ``merlin/execute``, one request after the other, the most urgent first.

What runs, waits and stops is decided in :mod:`merlin_executor.agenda`; here decisions become messages.
"""

import itertools
import threading
import traceback
from typing import List, Optional

import rospy
from merlin_msgs.msg import (
    ExecuteAction,
    ExecuteFeedback,
    ExecuteResult,
    ExecutorStatus,
    GoalQueue,
)

from merlin_executor.agenda import Agenda, Client, Decision
from merlin_executor.engine import Engine
from merlin_executor.executor_sm import ExecutorSM, PlanningSystem
from merlin_executor.goal_check import GoalError, check_goals
from merlin_executor.guard_client import GuardClient
from merlin_executor.outcome import Verdict, crashed
from merlin_executor.own_goals import OwnGoals
from merlin_executor.recovery import Recovery
from merlin_executor.request import Request
from merlin_executor.request_limits import RequestTooLarge
from merlin_sm.action_server import ActionServer, ServerGoal
from merlin_sm.dispatch_client import DispatchClient
from merlin_sm.health import OK, WARN, Health
from merlin_sm.introspection import show
from merlin_sm.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_sm.lease import LeaseState
from merlin_sm.pddl_text import PDDLSyntaxError
from merlin_sm.planning_client import PlanningClient
from merlin_sm.publishing import publish
from merlin_sm.service_proxy import ServiceError

STATUS_WAIT = 1.0  # s of running time at start for the dispatcher's status; ROSPlan's own publish none
END_WAIT = 1.5  # s of wall time for the running request to end when the node does
LONGEST_REASON = 2000  # characters of the last reason in the status
_CLIENTS = {LeaseState.SUSPENDED: Client.SILENT, LeaseState.LOST: Client.GONE}


class Executor:
    """Queues requests and runs them through :class:`ExecutorSM`.

    :param knowledge: of the planning system.
    :param planning: its stages before dispatch.
    :param dispatcher: name of its dispatcher.
    :param cancel_deadline: s of running time for a cancelled plan to stop; zero or less: no limit.
    :param max_replans: how often a failed plan is replaced.
    :param goals_file: where it notes the goals it added; empty: on the parameter server.
    :param return_wait: s of running time for a planning system that was ended to return.
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
        return_wait: float = 10.0,
    ) -> None:
        self._knowledge = knowledge
        self._max_replans = max_replans
        self._own = OwnGoals(knowledge, goals_file)
        self._dispatcher = DispatchClient(dispatcher, knowledge.name, cancel_deadline, self._publish_status)
        self._recovery = Recovery(knowledge, self._dispatcher)
        system = PlanningSystem(
            knowledge, planning, self._dispatcher, self._recovery, GuardClient(), return_wait
        )
        self._machine = ExecutorSM(system, self._own, self._publish_status)
        self._server = ActionServer("merlin/execute", ExecuteAction, self._receive, self._cancel, self._owner)
        self._engine: Engine[Request] = Engine(
            self._machine, self._publish_status, self._publish_queue, self._ended
        )
        self._lock = threading.Lock()  # guards the two fields below
        self._reason = ""
        self._ill = False  # the last request failed for a reason that is not the world's
        self._order = itertools.count()
        self._publishing = threading.Lock()  # keeps published statuses and queues in order

    def start(self) -> None:
        """Puts right what a killed Executor left and begins to serve."""
        self._dispatcher.wait_status(STATUS_WAIT)
        self._recover()
        self._status_publisher = rospy.Publisher("merlin/status", ExecutorStatus, latch=True, queue_size=10)
        self._queue_publisher = rospy.Publisher("merlin/queue", GoalQueue, latch=True, queue_size=10)
        self._introspection = show("EXECUTOR", self._machine)
        self._publish_status()
        self._publish_queue()
        self._engine.start()
        self._server.start()

    def shutdown(self) -> None:
        """Cancels what runs, answers what waits, and stops serving."""
        self._engine.shutdown(END_WAIT)
        self._server.shutdown()
        self._introspection.stop()

    def health(self) -> Health:
        """What it does; a warning when the last request failed because of software."""
        running, waiting = self._engine.running, len(self._engine.waiting)
        with self._lock:
            reason, ill = self._reason, self._ill
        doing = f"running {', '.join(running.texts)}" if running is not None else "idle"
        return Health(
            WARN if ill else OK,
            f"{doing}; last: {reason}" if ill else doing,
            {"waiting requests": waiting, "last request": reason},
        )

    # --- events, in threads of the action server ----------------------------------------------------------

    def _receive(self, goal: ServerGoal) -> None:
        try:
            request = Request(goal, next(self._order), self._max_replans)
            check_goals(request.items, self._knowledge)
        except (PDDLSyntaxError, GoalError, RequestTooLarge) as error:
            self._refuse(goal, str(error))
        except ServiceError as error:
            self._refuse(goal, f"the goals could not be checked: {error}")
        except BaseException as error:  # the client gets its answer, whatever it sent
            rospy.logerr(f"executor: {traceback.format_exc(limit=20)}")
            self._refuse(goal, f"the request could not be read: {crashed(error).reason}")
        else:
            self._engine.decide(lambda agenda: agenda.receive(request, goal.cancel_requested))

    def _cancel(self, goal: ServerGoal) -> None:
        self._engine.decide_on(
            lambda request: request.goal is goal, lambda agenda, request: agenda.cancel(request)
        )

    def _owner(self, goal: ServerGoal, state: LeaseState, reason: str) -> Optional[bool]:
        client = _CLIENTS.get(state, Client.ALIVE)
        goes_on = False

        def decide(agenda: Agenda[Request], request: Request) -> List[Decision]:
            nonlocal goes_on
            goes_on = request.goes_on
            return agenda.client(request, client, reason)

        self._engine.decide_on(lambda request: request.goal is goal, decide)
        return not goes_on

    @staticmethod
    def _refuse(goal: ServerGoal, reason: str) -> None:
        rospy.logwarn(f"refused a request: {reason}")
        goal.reject(ExecuteResult(outcome=ExecuteResult.REFUSED, reason=reason), reason)

    # --- what is told -------------------------------------------------------------------------------------

    def _ended(self, request: Request, verdict: Verdict, error: Optional[BaseException]) -> None:
        if error is not None:
            rospy.logerr(
                "executor: " + "".join(traceback.format_exception(type(error), error, error.__traceback__))
            )
        with self._lock:
            self._ill = verdict.outcome.of_software
            self._reason = f"{', '.join(request.texts)}: {verdict.reason or 'done'}"[:LONGEST_REASON]
            rospy.loginfo(self._reason)

    def _publish_status(self) -> None:
        with self._publishing:
            request = self._engine.running
            status = ExecutorStatus(state=ExecutorStatus.IDLE, reason=self._reason)
            status.header.stamp = rospy.Time.now()
            if request is not None:
                status.state = ExecutorStatus.CANCELLING if request.stop else ExecutorStatus.RUNNING
                status.request = request.goal.id
                status.goals = request.texts
                status.priority = request.priority
                status.stage = request.course.stage
                status.running = self._dispatcher.running
                status.steps_done = self._dispatcher.steps_done if request.plan else 0
                status.steps_total = len(request.plan)
                status.replans = request.course.replans
                request.goal.feedback(
                    ExecuteFeedback(
                        stage=status.stage,
                        running=status.running,
                        steps_done=status.steps_done,
                        steps_total=status.steps_total,
                        reason=status.reason,
                    )
                )
            publish(self._status_publisher, status)

    def _publish_queue(self) -> None:
        with self._publishing:
            message = GoalQueue(requests=[request.queued_goal() for request in self._engine.waiting])
            message.header.stamp = rospy.Time.now()
            publish(self._queue_publisher, message)

    # --- a former life ------------------------------------------------------------------------------------

    def _recover(self) -> None:
        """Ends what an Executor that was killed has left: its dispatch, its executions, its goals."""
        try:
            trouble = self._recovery.rest(lambda interrupt: None)
            if trouble:
                rospy.logerr(f"what an earlier executor left is not settled yet: {trouble}")
            texts = self._own.remove_left()
        except (KnowledgeError, ServiceError, OSError) as error:
            rospy.logerr(f"what an earlier executor left stays in the knowledge base: {error}")
            return
        if texts:
            rospy.logwarn(f"removed the goals that an earlier executor left: {', '.join(texts)}")
