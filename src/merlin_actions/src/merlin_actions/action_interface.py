"""ActionInterface: between a plan dispatcher and the code that runs one operator, as in ROSPlan.

The life of an execution: bind the parameters, answer *enabled*, apply the start effects, run, then apply the
end effects and answer *succeeded*, or put the knowledge right and answer *failed* with the reason. There is
always exactly one final answer.
"""

import threading
import time
import traceback
from typing import Dict, List, Optional

import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions.effects import effects_of
from merlin_actions.execution import Ending, Execution, Key
from merlin_actions.names import action_param
from merlin_sm.deadline import running_time
from merlin_sm.knowledge_client import (
    ADD,
    DEFAULT_KNOWLEDGE_BASE,
    REMOVE,
    KnowledgeClient,
    KnowledgeError,
    Update,
    knowledge_client,
)
from merlin_sm.pddl_text import parse_literals
from merlin_sm.publishing import publish
from merlin_sm.service_proxy import ServiceError

CANCEL_ACTION = "cancel_action"
ANNOUNCE_PERIOD = 1.0  # s of wall time between two announcements on pddl_action_parameters
LATCH_GRACE = 0.3  # s after connecting to a dispatcher in which its latched, perhaps old, message arrives
CONNECTION_LOOK = 0.02  # s between two looks for that connection, which rospy announces to nobody
_KNOWLEDGE_ERRORS = (KnowledgeError, ServiceError, ValueError)


class ActionInterface:
    """Serves one PDDL operator. Subclasses implement :meth:`run`.

    :param operator: its name in the domain.
    :param knowledge_base: name of the knowledge base.
    :param dispatch_topic: where actions are dispatched.
    :param feedback_topic: where they are answered.
    :raises KnowledgeError: when the domain has no such operator.
    :raises ValueError: when the knowledge base cannot apply its effects.
    """

    concurrent = False
    """Whether the operator may run several times at once; otherwise a second dispatch is refused."""

    def __init__(
        self,
        operator: str,
        knowledge_base: str = DEFAULT_KNOWLEDGE_BASE,
        dispatch_topic: str = "rosplan_plan_dispatcher/action_dispatch",
        feedback_topic: str = "rosplan_plan_dispatcher/action_feedback",
    ) -> None:
        self.operator = operator
        self.knowledge: KnowledgeClient = knowledge_client(knowledge_base)
        try:
            details = self.knowledge.operator(operator)
        except ServiceError as error:
            raise KnowledgeError(f"no operator {operator!r} in {self.knowledge.name}: {error}") from error
        self.formula: DomainFormula = details.formula
        self._effects = effects_of(details, self.knowledge)
        self._lock = threading.Lock()  # guards _executions
        self._executions: Dict[Key, Execution] = {}
        self._stopped = threading.Event()
        self._topics = (dispatch_topic, feedback_topic)

    def start(self) -> None:
        """Begins to serve."""
        dispatch_topic, feedback_topic = self._topics
        self._connected: Optional[float] = None
        self._feedback = rospy.Publisher(feedback_topic, ActionFeedback, latch=True, queue_size=10)
        self._announcements = rospy.Publisher(
            f"{self.knowledge.name}/pddl_action_parameters", DomainFormula, latch=True, queue_size=10
        )
        self._subscriber = rospy.Subscriber(dispatch_topic, ActionDispatch, self._receive, tcp_nodelay=True)
        threading.Thread(target=self._announce, name=f"announce {self.operator}", daemon=True).start()

    def shutdown(self) -> None:
        """Cancels what runs and stops serving."""
        self._stopped.set()
        self._subscriber.unregister()
        for execution in self.executions():
            execution.cancel()

    def executions(self) -> List[Execution]:
        """What runs now."""
        with self._lock:
            return list(self._executions.values())

    def run(self, execution: Execution) -> Ending:
        """Runs the action to its end, in a thread of its own.

        Announce with :meth:`Execution.interruptible` what a cancel has to do; it is called in the
        subscriber's thread, at once.
        """
        raise NotImplementedError(f"{type(self).__name__} has to implement run()")

    def _receive(self, dispatch: ActionDispatch) -> None:
        if dispatch.name == CANCEL_ACTION:
            for execution in self.executions():
                if execution.matches(dispatch):
                    execution.cancel()
        elif dispatch.name.lower() == self.operator.lower():
            if self._stale(dispatch):
                rospy.loginfo(f"{self.operator}: ignored a dispatch that is older than this interface")
                return
            self._begin(dispatch)

    def _stale(self, dispatch: ActionDispatch) -> bool:
        """Whether a dispatch was latched before this interface began; an old one must not run again."""
        header = getattr(dispatch, "_connection_header", None) or {}
        connected = self._connected
        young = connected is None or running_time() - connected < LATCH_GRACE
        return header.get("latching") == "1" and young and not self._expected(dispatch)

    def _expected(self, dispatch: ActionDispatch) -> bool:
        """Whether the dispatcher is known to wait for this action now."""
        return False

    def _begin(self, dispatch: ActionDispatch) -> None:
        given = {parameter.key: parameter.value for parameter in dispatch.parameters}
        variables = [parameter.key for parameter in self.formula.typed_parameters]
        missing = [variable for variable in variables if variable not in given]
        if missing:
            self._answer(
                dispatch,
                ActionFeedback.ACTION_FAILED,
                f"{self.operator}: no value for parameter {', '.join('?' + name for name in missing)}",
            )
            return
        execution = Execution(dispatch, [KeyValue(key, given[key]) for key in variables])
        with self._lock:
            if execution.key in self._executions:
                rospy.logwarn(f"{execution.text} was dispatched twice with the same ids; it runs once")
                return
            refused = bool(self._executions) and not self.concurrent
            if not refused:
                self._executions[execution.key] = execution
        if refused:
            self._answer(dispatch, ActionFeedback.ACTION_FAILED, f"{self.operator} runs already")
            return
        self._answer(dispatch, ActionFeedback.ACTION_ENABLED)
        self._spawn(execution)

    def _spawn(self, execution: Execution) -> None:
        threading.Thread(
            target=self._carry_out, args=(execution,), name=f"run {execution.text}", daemon=True
        ).start()

    def _carry_out(self, execution: Execution) -> None:
        ending = self._run_with_effects(execution)
        with self._lock:
            del self._executions[execution.key]
        if ending.succeeded:
            self._answer(execution.dispatch, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE)
        else:
            rospy.loginfo(f"{execution.text} did not succeed: {ending.reason}")
            self._answer(execution.dispatch, ActionFeedback.ACTION_FAILED, ending.reason)

    def _run_with_effects(self, execution: Execution) -> Ending:
        meanwhile = self._declared("while_running")
        try:
            self._effects.start(execution.parameters, execution.token)
        except _KNOWLEDGE_ERRORS as error:
            return Ending(False, f"the start effects could not be applied: {error}")
        try:
            self._change(meanwhile, execution)
        except _KNOWLEDGE_ERRORS as error:
            ending = Ending(False, f"what holds while it runs could not be applied: {error}", begun=False)
            meanwhile = []
        else:
            ending = self._run_guarded(execution)
        wrong: List[str] = []
        for update in (
            lambda: self._change(meanwhile, execution, undo=True),
            lambda: self._conclude(execution, ending),
        ):
            try:
                update()
            except _KNOWLEDGE_ERRORS as error:
                rospy.logerr(f"{execution.text}: {error}")
                wrong.append(str(error))
        if not wrong:
            return ending
        return Ending(
            False, f"{ending.reason or 'it ran'}, and the knowledge could not be updated: {'; '.join(wrong)}"
        )

    def _run_guarded(self, execution: Execution) -> Ending:
        try:
            return self.run(execution)
        except Exception as error:  # user code may raise anything; the dispatcher still gets its answer
            rospy.logerr(f"{execution.text}: {traceback.format_exc()}")
            return Ending(False, f"{type(error).__name__}: {error}")
        finally:
            execution.interruptible(None)

    def _conclude(self, execution: Execution, ending: Ending) -> None:
        if ending.succeeded:
            self._effects.end(execution.parameters, execution.token)
        else:
            self._put_right(execution, ending)

    def _put_right(self, execution: Execution, ending: Ending) -> None:
        """After an interruption: what the action declares for this case, else as it was before."""
        declared = self._declared("if_interrupted") if ending.begun else []
        if declared:
            self._change(declared, execution)
        else:
            self._effects.rollback(execution.parameters, execution.token)

    def _declared(self, key: str) -> List[str]:
        """Facts that the action's class declares under a key; its host publishes them as a parameter."""
        return list(rospy.get_param(action_param(self.operator, key), []))

    def _change(self, literals: List[str], execution: Execution, undo: bool = False) -> None:
        updates = []
        for item in parse_literals(literals, execution.binding):
            remove = bool(item.is_negative) != undo
            item.is_negative = False
            updates.append(Update(REMOVE if remove else ADD, item))
        if updates:
            self.knowledge.update(sorted(updates, key=lambda update: update.kind != REMOVE))

    def _answer(self, dispatch: ActionDispatch, status: int, reason: Optional[str] = None) -> None:
        information = [KeyValue("reason", reason)] if reason else []
        feedback = ActionFeedback(
            action_id=dispatch.action_id, plan_id=dispatch.plan_id, status=status, information=information
        )
        publish(self._feedback, feedback)

    def _announce(self) -> None:
        # Who announces itself is ready: whatever was latched before has come and gone.
        while not self._subscriber.get_num_connections():
            if self._stopped.wait(CONNECTION_LOOK) or rospy.is_shutdown():
                return
        self._connected = running_time()
        self._stopped.wait(LATCH_GRACE)
        # Wall time: a paused simulator must not make an interface look dead.
        while not rospy.is_shutdown():
            self._announcements.publish(self.formula)
            if self._stopped.wait(ANNOUNCE_PERIOD):
                return


def wait_for_knowledge_base(name: str, timeout: float) -> None:
    """Waits until a knowledge base answers.

    :param timeout: s of wall time.
    :raises KnowledgeError: when it does not.
    """
    began = time.monotonic()
    knowledge = knowledge_client(name)
    if not knowledge.wait(timeout):
        waited = time.monotonic() - began
        raise KnowledgeError(f"no knowledge base {knowledge.name} after {waited:.0f} s; is it launched?")
