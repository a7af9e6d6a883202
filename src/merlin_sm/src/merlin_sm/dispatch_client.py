"""Has a plan dispatched, follows its actions, and cancels it, over our dispatchers and ROSPlan's own."""

import threading
from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple

import rospy
from merlin_msgs.msg import DispatchStatus, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_dispatch_msgs.srv import DispatchService, DispatchServiceResponse
from rosplan_knowledge_msgs.msg import DomainFormula
from std_srvs.srv import Empty

from merlin_sm.deadline import Deadline, limit
from merlin_sm.knowledge_client import DEFAULT_KNOWLEDGE_BASE
from merlin_sm.pddl_text import action_text
from merlin_sm.planning_client import Interruptible
from merlin_sm.service_proxy import ServiceError, ServiceProxy

CANCEL_ACTION = "cancel_action"
ENDINGS = (ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE, ActionFeedback.ACTION_FAILED)
INTERFACE_WAIT = 3.0  # s of running time for the action interfaces of a plan to announce themselves
STATUS_GRACE = 0.5  # s of running time for the dispatcher's status behind its answer
FAILURE_GRACE = 0.5  # s of running time for a dispatcher to stop by itself after a failed action


Ground = Tuple[str, Tuple[str, ...]]


class DispatchResult(NamedTuple):
    """How a dispatch ended."""

    goal_achieved: bool
    cancelled: bool = False
    timed_out: bool = False
    """The dispatch did not end in time after a cancel."""
    action: str = ""
    """The action that failed, as PDDL text."""
    reason: str = ""


class DispatchClient:
    """One dispatcher.

    :param dispatcher: its name (scope).
    :param knowledge_base: where action interfaces announce themselves.
    :param cancel_deadline: s of running time for a cancelled dispatch to end; zero or less: no limit.
    :param on_change: called when the running actions or the steps done change, in a subscriber's thread.
    """

    def __init__(
        self,
        dispatcher: str = "rosplan_plan_dispatcher",
        knowledge_base: str = DEFAULT_KNOWLEDGE_BASE,
        cancel_deadline: float = 5.0,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.name = rospy.resolve_name(dispatcher)
        self.cancel_deadline = cancel_deadline
        self._on_change = on_change
        self._dispatch = ServiceProxy(f"{dispatcher}/dispatch_plan", DispatchService)
        self._cancel = ServiceProxy(f"{dispatcher}/cancel_dispatch", Empty, timeout=2.0)
        self._changed = threading.Condition()  # guards the fields below
        self._running: Dict[int, RunningAction] = {}
        self._steps_done = 0
        self._failed = ""
        self._failed_reason = ""
        self._active = False
        self._cancelling = False
        self._requested = False
        self._first_expected: Optional[Ground] = None
        self._first_seen: Optional[Ground] = None
        self._cancel_sent = False
        self._ended = True
        self._announced: Set[str] = set()
        self._status: Optional[DispatchStatus] = None
        self._statuses = 0
        self._cancel_publisher = rospy.Publisher(
            f"{dispatcher}/action_dispatch", ActionDispatch, queue_size=10
        )
        for topic, message_class, callback in (
            ("action_dispatch", ActionDispatch, self._receive_dispatch),
            ("action_feedback", ActionFeedback, self._receive_feedback),
            ("dispatch_status", DispatchStatus, self._receive_status),
        ):
            rospy.Subscriber(f"{dispatcher}/{topic}", message_class, callback, tcp_nodelay=True)
        announcements = f"{rospy.resolve_name(knowledge_base)}/pddl_action_parameters"
        rospy.Subscriber(announcements, DomainFormula, self._receive_interface)

    def wait(self, timeout: float) -> bool:
        """Waits until the dispatcher is there, s of wall time."""
        return self._dispatch.wait(timeout)

    @property
    def running(self) -> List[RunningAction]:
        """The actions under way."""
        with self._changed:
            return list(self._running.values())

    @property
    def steps_done(self) -> int:
        """Actions of this dispatch that have succeeded."""
        return self._steps_done

    def dispatch(self, interruptible: Interruptible, plan: Sequence[ActionDispatch] = ()) -> DispatchResult:
        """Dispatches the present plan and waits for its end. The interruption cancels it.

        :param plan: what is meant. ROSPlan's dispatchers may still hold an older plan when they are called;
            one that begins with another action, or with none, is cancelled and dispatched again.
        """
        result = self._dispatch_once(interruptible, plan)
        if self._stale(result, plan):
            rospy.logwarn(f"{self.name} did not have the new plan yet; dispatching again")
            result = self._dispatch_once(interruptible, plan)
        return result

    def _dispatch_once(self, interruptible: Interruptible, plan: Sequence[ActionDispatch]) -> DispatchResult:
        with self._changed:
            self._running.clear()
            self._steps_done = self._statuses = 0
            self._failed = self._failed_reason = ""
            self._first_expected = _ground(plan[0]) if plan else None
            self._first_seen = None
            self._active = True
            self._ended = self._cancelling = self._cancel_sent = self._requested = False
            if self._status is None:
                # ROSPlan's dispatchers wait for ever for an interface that was not there in time.
                operators = {action.name.lower() for action in plan}
                Deadline(INTERFACE_WAIT).wait(self._changed, lambda: operators <= self._announced)
        answers: List[object] = []

        def call() -> None:
            try:
                answers.append(self._dispatch())
            except ServiceError as error:
                answers.append(error)
            with self._changed:
                self._ended = True
                self._changed.notify_all()

        threading.Thread(target=call, name=f"dispatch of {self.name}", daemon=True).start()
        interruptible(self.cancel)
        in_time = self._wait_for_end()
        interruptible(None)
        with self._changed:
            self._active = False
            running = [action_text(action.name, action.parameters) for action in self._running.values()]
            self._running.clear()
        self._on_change()
        if not in_time:
            self._dispatch = ServiceProxy(f"{self.name}/dispatch_plan", DispatchService)
            names = ", ".join(running) or self.name
            return DispatchResult(
                False, True, True, names, f"{names} did not stop within {self.cancel_deadline:g} s"
            )
        return self._result(answers[0])

    def cancel(self) -> None:
        """Cancels the running dispatch, in the caller's thread; before it runs, as soon as it does."""
        with self._changed:
            if self._ended or self._requested:
                return
            self._requested = self._cancelling = True
            self._changed.notify_all()
            ready = self._seen()
        if ready:
            self._send_cancel()

    def _wait_for_end(self) -> bool:
        """False when a cancelled dispatch does not end within its deadline."""
        with self._changed:
            Deadline(None).wait(self._changed, lambda: self._ended or self._cancelling or bool(self._failed))
            if self._failed and not self._ended and not self._cancelling and self._status is None:
                # ROSPlan's esterel dispatcher does not notice a failed action.
                Deadline(FAILURE_GRACE).wait(self._changed, lambda: self._ended or self._cancelling)
                self._cancelling = True
            elif not self._ended and not self._cancelling:
                Deadline(None).wait(self._changed, lambda: self._ended or self._cancelling)
            if self._ended:
                return True
            # A cancel sent before the dispatcher runs would be lost, or stop ROSPlan's next dispatch instead.
            patience = limit(self.cancel_deadline)
            deadline = Deadline(patience)
            if not deadline.wait(self._changed, lambda: self._ended or self._seen()):
                return False
        self._send_cancel()
        # The dispatcher keeps the same deadline and names who did not answer; it gets a moment longer.
        slack = Deadline(None if patience is None else patience + 1.0)
        with self._changed:
            return slack.wait(self._changed, lambda: self._ended)

    def _stale(self, result: DispatchResult, plan: Sequence[ActionDispatch]) -> bool:
        """Whether a dispatcher of ROSPlan's ran something else than the plan that was meant."""
        with self._changed:
            if self._status is not None or self._requested or result.goal_achieved or not plan:
                return False
            return self._first_seen != self._first_expected

    def _seen(self) -> bool:
        """Whether the dispatcher is known to run; called with the lock held."""
        if self._status is not None:
            return self._status.state != DispatchStatus.IDLE
        return bool(self._running or self._failed)

    def _send_cancel(self) -> None:
        with self._changed:
            if self._cancel_sent or self._ended:
                return
            self._cancel_sent = True
            running = list(self._running.values()) if self._status is None else []
        try:
            self._cancel()
        except ServiceError as error:
            rospy.logwarn(f"cancel of {self.name}: {error}")
        for action in running:  # ROSPlan's simple dispatcher tells nobody
            self._cancel_publisher.publish(
                ActionDispatch(
                    action_id=action.action_id,
                    plan_id=action.plan_id,
                    name=CANCEL_ACTION,
                    parameters=action.parameters,
                )
            )

    def _result(self, answer: object) -> DispatchResult:
        with self._changed:
            cancelled = self._requested and not self._failed_before_cancel()
            action, reason = self._failed, self._failed_reason
            if not getattr(answer, "goal_achieved", False) and self._status is not None:
                # The last word of our dispatcher may come a moment behind the answer of its service.
                Deadline(STATUS_GRACE).wait(
                    self._changed, lambda: self._statuses > 0 and self._status.state == DispatchStatus.IDLE
                )
            status = self._status if self._statuses else None
        if isinstance(answer, ServiceError):
            return DispatchResult(False, cancelled, False, action, str(answer))
        assert isinstance(answer, DispatchServiceResponse)
        if answer.goal_achieved:
            return DispatchResult(True, cancelled)
        if status is not None:
            action, reason = status.failed_action or action, status.reason or reason
        return DispatchResult(
            False, cancelled, False, action, reason or "the plan ended, but the goal does not hold"
        )

    def _failed_before_cancel(self) -> bool:
        return bool(self._failed) and self._failed_reason != "cancelled"

    def _receive_dispatch(self, dispatch: ActionDispatch) -> None:
        with self._changed:
            if not self._active or dispatch.name == CANCEL_ACTION:
                return
            if self._first_seen is None:
                self._first_seen = _ground(dispatch)
                if self._status is None and self._first_expected not in (None, self._first_seen):
                    self._cancelling = True
            self._running[dispatch.action_id] = RunningAction(
                action_id=dispatch.action_id,
                plan_id=dispatch.plan_id,
                name=dispatch.name,
                parameters=dispatch.parameters,
                dispatched=rospy.Time.now(),
            )
            self._changed.notify_all()
        self._on_change()

    def _receive_feedback(self, feedback: ActionFeedback) -> None:
        with self._changed:
            action = self._running.get(feedback.action_id)
            if not self._active or action is None or feedback.status not in ENDINGS:
                return
            if feedback.plan_id not in (0, action.plan_id):
                return
            del self._running[feedback.action_id]
            if feedback.status == ActionFeedback.ACTION_FAILED:
                information = {entry.key: entry.value for entry in feedback.information}
                self._failed = action_text(action.name, action.parameters)
                self._failed_reason = information.get("reason", "no reason given")
            else:
                self._steps_done += 1
            self._changed.notify_all()
        self._on_change()

    def _receive_interface(self, formula: DomainFormula) -> None:
        with self._changed:
            self._announced.add(formula.name.lower())
            self._changed.notify_all()

    def _receive_status(self, status: DispatchStatus) -> None:
        with self._changed:
            self._status = status
            self._statuses += 1
            self._changed.notify_all()


def _ground(action: ActionDispatch) -> Ground:
    return action.name.lower(), tuple(parameter.value.lower() for parameter in action.parameters)
