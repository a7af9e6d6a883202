"""The Executor: serves ``merlin/execute``, one request after the other, the most urgent first."""

import itertools
import threading
import traceback
from typing import List, Optional

import rospy
from merlin_msgs.msg import (
    ExecuteAction,
    ExecuteFeedback,
    ExecuteGoal,
    ExecuteResult,
    ExecutorStatus,
    GoalQueue,
)

from merlin_executor.executor_sm import ExecutorSM
from merlin_executor.goal_check import GoalError, check_goals
from merlin_executor.own_goals import OwnGoals
from merlin_executor.request import Request, Stop, sorted_requests
from merlin_sm.action_server import ActionServer, ServerGoal
from merlin_sm.dispatch_client import DispatchClient
from merlin_sm.health import OK, WARN, Health
from merlin_sm.introspection import show
from merlin_sm.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_sm.pddl_text import PDDLSyntaxError
from merlin_sm.planning_client import PlanningClient
from merlin_sm.publishing import publish
from merlin_sm.service_proxy import ServiceError

#: Outcomes that call for somebody to look at a node.
_SOFTWARE = (ExecuteResult.PLANNER_ERROR, ExecuteResult.CANCEL_TIMEOUT, ExecuteResult.INTERNAL)


class Executor:
    """Queues requests and runs them through :class:`ExecutorSM`.

    :param knowledge: of the planning system.
    :param planning: its stages before dispatch.
    :param cancel_deadline: s of running time for a cancelled plan to stop; zero or less: no limit.
    :param max_replans: how often a failed plan is replaced.
    :param goals_file: where it notes the goals it added; empty: on the parameter server.
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
    ) -> None:
        self._knowledge = knowledge
        self._own = OwnGoals(knowledge, goals_file)
        self._dispatcher = DispatchClient(dispatcher, knowledge.name, cancel_deadline, self._publish_status)
        self._machine = ExecutorSM(
            knowledge, planning, self._dispatcher, self._own, max_replans, self._publish_status
        )
        self._server = ActionServer("merlin/execute", ExecuteAction, self._receive, self._cancel)
        self._changed = threading.Condition()  # guards the five fields below
        self._queue: List[Request] = []
        self._running: Optional[Request] = None
        self._stopping = False
        self._reason = ""
        self._ill = False  # the last request failed for a reason that is not the world's
        self._order = itertools.count()
        self._status_lock = threading.Lock()  # keeps published statuses in order
        self._status_publisher = rospy.Publisher("merlin/status", ExecutorStatus, latch=True, queue_size=10)
        self._queue_publisher = rospy.Publisher("merlin/queue", GoalQueue, latch=True, queue_size=10)
        self._worker = threading.Thread(target=self._work, name="executor", daemon=True)

    def start(self) -> None:
        """Removes what a killed Executor left and begins to serve."""
        self._remove_left_goals()
        self._introspection = show("EXECUTOR", self._machine)
        self._publish_status()
        self._publish_queue()
        self._worker.start()
        self._server.start()

    def shutdown(self) -> None:
        """Cancels what runs, answers what waits, and stops serving."""
        with self._changed:
            self._stopping = True
            waiting, self._queue = self._queue, []
            if self._running is not None:
                self._stop(self._running, Stop.SHUTDOWN)
            self._changed.notify_all()
        for request in waiting:
            request.end(ExecuteResult.CANCELLED, Stop.SHUTDOWN.value)
        self._worker.join(1.5)
        self._server.shutdown()
        self._introspection.stop()

    def health(self) -> Health:
        """What it does; a warning when the last request failed because of software."""
        with self._changed:
            running, waiting, reason, ill = self._running, len(self._queue), self._reason, self._ill
        doing = f"running {', '.join(running.texts)}" if running is not None else "idle"
        return Health(
            WARN if ill else OK,
            f"{doing}; last: {reason}" if ill else doing,
            {"waiting requests": waiting, "last request": reason},
        )

    def _receive(self, goal: ServerGoal) -> None:
        try:
            request = Request(goal, next(self._order))
            check_goals(request.items, self._knowledge)
        except (PDDLSyntaxError, GoalError) as error:
            self._refuse(goal, str(error))
            return
        except ServiceError as error:
            self._refuse(goal, f"the goals could not be checked: {error}")
            return
        with self._changed:
            refused, cancelled = self._stopping, goal.cancel_requested
            if not refused and not cancelled:
                self._queue = sorted_requests([*self._queue, request])
                running = self._running
                if running is not None and request.priority > running.priority:
                    self._stop(running, Stop.INTERRUPTED)
                self._changed.notify_all()
        if refused:
            self._refuse(goal, Stop.SHUTDOWN.value)
        elif cancelled:
            request.end(ExecuteResult.CANCELLED, "cancelled before it began")
        self._publish_queue()

    @staticmethod
    def _refuse(goal: ServerGoal, reason: str) -> None:
        rospy.logwarn(f"refused a request: {reason}")
        goal.reject(ExecuteResult(outcome=ExecuteResult.REFUSED, reason=reason), reason)

    def _cancel(self, goal: ServerGoal) -> None:
        with self._changed:
            running = self._running
            if running is not None and running.goal is goal:
                self._stop(running, Stop.CANCELLED)
                return
        request = self._take_from_queue(goal)
        if request is not None:
            request.end(ExecuteResult.CANCELLED, "cancelled before it began")
            self._publish_queue()

    def _take_from_queue(self, goal: ServerGoal) -> Optional[Request]:
        with self._changed:
            found = next((request for request in self._queue if request.goal is goal), None)
            if found is not None:
                self._queue.remove(found)
            return found

    def _stop(self, request: Request, why: Stop) -> None:
        """Stops the running request; called with the lock held, never blocks for long."""
        if request.stop in (None, Stop.INTERRUPTED):
            request.stop = why
        self._machine.cancel()

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._queue and not self._stopping:
                    self._changed.wait()
                if self._stopping:
                    return
                request = self._queue.pop(0)
                request.begin()
                self._machine.prepare()
                self._running = request
            request.goal.accept()
            self._publish_queue()
            try:
                outcome, reason = self._machine.run_request(request), self._machine.reason
            except Exception as error:  # the client gets its answer, and the Executor goes on
                rospy.logerr(f"executor: {traceback.format_exc()}")
                outcome, reason = ExecuteResult.INTERNAL, f"{type(error).__name__}: {error}"
            self._finish(request, outcome, reason)

    def _finish(self, request: Request, outcome: int, reason: str) -> None:
        with self._changed:
            self._running = None
            again = False
            if outcome == ExecuteResult.CANCELLED and request.stop is not None:
                reason = request.stop.value
                if request.stop == Stop.INTERRUPTED:
                    again = request.on_interrupt == ExecuteGoal.RESUME and not self._stopping
                    outcome = ExecuteResult.CANCELLED if again else ExecuteResult.DROPPED
            if again:
                request.interrupted = True
                self._queue = sorted_requests([*self._queue, request])
            self._ill = outcome in _SOFTWARE
            self._reason = f"{', '.join(request.texts)}: {reason or 'done'}"
        rospy.loginfo(self._reason)
        # Idle is published before the answer: who has the answer may rely on it.
        self._publish_status()
        if again:
            self._publish_queue()
        else:
            request.end(outcome, reason)

    def _publish_status(self) -> None:
        with self._status_lock:
            request = self._running
            status = ExecutorStatus(state=ExecutorStatus.IDLE, reason=self._reason)
            status.header.stamp = rospy.Time.now()
            if request is not None:
                status.state = ExecutorStatus.CANCELLING if request.stop else ExecutorStatus.RUNNING
                status.request = request.goal.id
                status.goals = request.texts
                status.priority = request.priority
                status.stage = request.stage
                status.running = self._dispatcher.running
                status.steps_done = self._dispatcher.steps_done if request.plan else 0
                status.steps_total = len(request.plan)
                status.replans = request.replans
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
        with self._changed:
            message = GoalQueue(requests=[request.queued_goal() for request in self._queue])
            message.header.stamp = rospy.Time.now()
            publish(self._queue_publisher, message)

    def _remove_left_goals(self) -> None:
        try:
            texts = self._own.remove_left()
        except (KnowledgeError, ServiceError, OSError) as error:
            rospy.logerr(f"goals of an earlier executor stay in the knowledge base: {error}")
            return
        if texts:
            rospy.logwarn(f"removed the goals that an earlier executor left: {', '.join(texts)}")
