# SPDX-License-Identifier: Apache-2.0
"""ActionInterface: between a plan dispatcher and the code that runs one operator, as in ROSPlan.

The life of an execution: bind the parameters, answer *enabled*, apply the start effects, run, then apply the
end effects and answer *succeeded*, or put the knowledge right and answer *failed* with the reason. There is
always exactly one final answer.
"""

import threading
from functools import partial
from typing import Any, Dict, List, Optional, Tuple, Union

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions.core.declared import bound, numeric_apart
from merlin_actions.core.ending import Ending, after_closing, closing_of, information_of
from merlin_actions.core.execution import Execution, Key, Token, at_once
from merlin_actions.core.latched import LATCH_GRACE, Latched
from merlin_actions.core.names import CONCURRENT, IF_INTERRUPTED, IF_STOPPED_AT, WHILE_RUNNING, action_param
from merlin_actions.effects import APPLY_LIMIT, Opening, effects_of
from merlin_actions.shutdown_order import MASTER_LOST, Serving
from merlin_planning.dispatch_progress import CANCEL_ACTION
from merlin_planning.execution_journal import ExecutionJournal, execution_text
from merlin_planning.knowledge_client import (
    DEFAULT_KNOWLEDGE_BASE,
    KnowledgeClient,
    KnowledgeError,
    knowledge_client,
)
from merlin_planning.knowledge_text import parse_literals
from merlin_ros.actions.hang_watch import hangs
from merlin_ros.actions.lease import LeaseChange, LeaseState
from merlin_ros.actions.lease_holder import LIFE
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.actions.ownership import ownership
from merlin_ros.actions.peers import connected_peers, sender_of
from merlin_ros.alarms import Alarm, call_later, every
from merlin_ros.deadline import call_when_passed, running_time
from merlin_ros.master.master_link import MasterSilent, get_param
from merlin_ros.node import master_is_lost
from merlin_ros.publishing import OnSubscriber, publish, unregister
from merlin_ros.ros_alarm import RosStopwatch
from merlin_ros.service_proxy import ServiceError, ServiceUnavailable, when_back
from merlin_ros.work.threads import log_failure, start_thread
from merlin_ros.work.work_book import Decision, Policy, Step, WorkBook

ANNOUNCE_PERIOD = 1.0  # s of wall time between two announcements on pddl_action_parameters
CONNECTION_LOOK = 0.02  # s between two looks for that connection, of which rospy gives no event
WAIT_LIMIT = 5.0  # s, of running time and of ROS time, in which an execution that is in the way has to end
WAITS = 6  # so often that limit of running time at most, where ROS time is slower, or stands
ON_TIME = 0.9  # share of running time from which on ROS time is not slower
_KNOWLEDGE_ERRORS = (KnowledgeError, ServiceError, ValueError, MasterSilent)
#: Answers that wait for the dispatcher's connection; rospy drops the oldest of more, and says nothing.
QUEUE = 1000


def settle_left(knowledge: KnowledgeClient, operator: str) -> List[Tuple[Key, str]]:
    """Closes the open executions of an operator that an earlier process of this node has left.

    Nothing of them continues: their state machines have lost their owner.

    :return: those that were settled, each with its PDDL text.
    :raises KnowledgeError: when the knowledge base refuses.
    :raises merlin_ros.service_proxy.ServiceError: when it does not answer.
    """
    journal = ExecutionJournal(knowledge.name, APPLY_LIMIT)
    if not journal.offered():
        return []  # the original ROSPlan
    settled = []
    for execution in journal.open(rospy.get_name()):
        token = Token.read(execution.token)
        if execution.operator_name.lower() != operator.lower() or not token.left_by_earlier(LIFE):
            continue
        refused = journal.interrupt(execution)
        text = execution_text(execution)
        if refused:
            raise KnowledgeError(f"{text} of an earlier process cannot be settled: {refused}")
        if token.key is not None:
            settled.append((token.key, text))
    return settled


class ActionInterface(Serving):
    """Serves one PDDL operator, as ROSPlan's ``RPActionInterface`` does. Subclasses implement :meth:`run`.

    The owner of an execution is the dispatcher that leases it. An execution waits for those before it, and
    stops those of an older plan. One that ends without its end effects is put right in the knowledge base.

    :param operator: its name in the domain.
    :param knowledge_base: name of the knowledge base.
    :param dispatch_topic: where actions are dispatched.
    :param feedback_topic: where they are answered.
    :raises KnowledgeError: when the domain has no such operator.
    :raises ValueError: when the knowledge base cannot apply its effects.
    """

    concurrent: Union[bool, int] = False
    """How many executions may run at once, True: any number; the next one waits for an end. What the host of
    the action declares, counts more."""

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
        self._changed = threading.Condition()  # guards the three fields below
        self._latched = Latched()
        self._executions: Dict[Key, Execution] = {}
        self._book: WorkBook[Key] = WorkBook(Policy.IN_TURN, at_once(self.concurrent))
        self._stopped = threading.Event()
        self._announces: Optional[Alarm] = None
        self._topics = (dispatch_topic, feedback_topic)

    def start(self) -> None:
        """Begins to serve."""
        dispatch_topic, feedback_topic = self._topics
        hangs.begin()  # a run that goes on after a hang may send its goal before the cancel is read
        self._owners = LeaseWatch(f"{self._dispatcher}/lease", self._owner_changed)
        self._feedback = rospy.Publisher(feedback_topic, ActionFeedback, latch=True, queue_size=QUEUE)
        self._announcements = rospy.Publisher(
            f"{self.knowledge.name}/pddl_action_parameters",
            DomainFormula,
            # A process latches but the last one of its actions.
            subscriber_listener=OnSubscriber(lambda _: call_later(0.0, self._greet)),
            latch=True,
            queue_size=10,
        )
        self._dispatcher_status = rospy.Subscriber(
            f"{self._dispatcher}/dispatch_status", DispatchStatus, self._note_dispatcher, tcp_nodelay=True
        )
        self._subscriber = rospy.Subscriber(dispatch_topic, ActionDispatch, self._receive, tcp_nodelay=True)
        start_thread(f"announce {self.operator}", self._announce)

    @property
    def _dispatcher(self) -> str:
        """Global name of the dispatcher."""
        return rospy.resolve_name(self._topics[0]).rsplit("/", 1)[0]

    def stop(self) -> None:
        """See :class:`.Serving`."""
        with self._changed:
            self._stopped.set()
            decisions = self._book.cancel_all("its action interface shuts down")
        if self._announces is not None:
            self._announces.cancel()
        self._carry_out(decisions)

    def wait_stopped(self, seconds: float) -> bool:
        """See :class:`.Serving`."""
        with self._changed:
            return self._changed.wait_for(lambda: self._book.idle, seconds)

    def close(self) -> None:
        """See :class:`.Serving`."""
        self._owners.shutdown()
        unregister(self._subscriber, self._dispatcher_status)

    def executions(self) -> List[Execution]:
        """What runs now, or waits to."""
        with self._changed:
            return list(self._executions.values())

    def ready(self, execution: Execution) -> Optional[Ending]:
        """Waits for the node that executes the action, before the start effects.

        :return: why the action cannot begin; None: it can.
        """
        return None

    def run(self, execution: Execution) -> Ending:
        """Runs the action to its end, in a thread of its own.

        Announce with :meth:`Execution.interruptible` what a cancel has to do; it is called in the
        subscriber's thread, at once.
        """
        raise NotImplementedError(f"{type(self).__name__} has to implement run()")

    def _receive(self, dispatch: ActionDispatch) -> None:
        cancels = dispatch.name == CANCEL_ACTION
        begins = not cancels and dispatch.name.lower() == self.operator.lower()
        with self._changed:
            old = self._latched.may_be_old(dispatch, running_time())
            if cancels:
                self._latched.drop(dispatch)
            aside = begins and not self._latched.begins(dispatch, old)
        if aside:
            rospy.loginfo(f"{self.operator}: put a dispatch aside that may be older than this interface")
        elif begins:
            self._begin(dispatch)
        for execution in self.executions() if cancels else ():
            if execution.matches(dispatch):
                self._cancel(execution, "cancelled")

    def _note_dispatcher(self, status: DispatchStatus) -> None:
        """Begins what was put aside if the dispatcher waits for it. ROSPlan's own tells no status."""
        with self._changed:
            awaited = self._latched.take([(action.plan_id, action.action_id) for action in status.running])
        for dispatch in awaited:
            self._begin(dispatch)

    def _cancel(self, execution: Execution, reason: str) -> None:
        self._decide(lambda book: book.cancel(execution.key, reason))

    def _owner_changed(self, change: LeaseChange) -> None:
        """The dispatcher is silent, back, or gone."""
        for execution in self.executions():
            if change.goal != execution.lease:
                continue
            if change.state is LeaseState.HELD:
                ownership.resume(execution.token)
                continue
            ownership.suspend(execution.token)
            if change.state is LeaseState.LOST:
                rospy.logwarn(f"{execution.text} is cancelled, {change.reason}")
                self._cancel(execution, change.reason)
            if execution.key not in self._executions:  # it ended meanwhile, and nothing else would resume it
                ownership.resume(execution.token)

    def _begin(self, dispatch: ActionDispatch) -> None:
        key = dispatch.plan_id, dispatch.action_id
        given = {parameter.key: parameter.value for parameter in dispatch.parameters}
        variables = [parameter.key for parameter in self.formula.typed_parameters]
        missing = ["?" + variable for variable in variables if variable not in given]
        if missing:
            self._answer(key, Ending(False, f"{self.operator}: no value for parameter {', '.join(missing)}"))
            return
        if master_is_lost():
            self._answer(key, Ending(False, MASTER_LOST))
            return
        execution = Execution(dispatch, [KeyValue(key, given[key]) for key in variables], LIFE)
        execution.lane = self._lane(execution)
        with self._changed:
            if self._stopped.is_set():
                return  # it waits for the next process: a plan that fails at once is soon given up
            decisions = self._book.arrive(execution.key, execution.lane, dispatch.plan_id)
            if decisions:
                self._executions[execution.key] = execution
        if not decisions:
            rospy.logwarn(f"{execution.text} was dispatched twice with the same ids; it runs once")
            return
        self._owners.arrive(execution.lease, sender_of(dispatch))
        self._answer(execution.key)
        self._owners.tell(execution.lease)  # which came before it
        self._carry_out(decisions)

    def _carry_out(self, decisions: List[Decision]) -> None:
        for decision in decisions:
            with self._changed:
                execution = self._executions.get(decision.key)
            if execution is None:
                continue
            if decision.what is Step.RUN:
                self._spawn(execution)
            elif decision.what is Step.STOP:
                execution.cancel(decision.reason)
            elif decision.what is Step.WAIT:
                self._limit_wait(execution, RosStopwatch(), WAITS)
            else:
                execution.cancel(decision.reason)
                self._end(execution, Ending(False, decision.reason, begun=False))

    def _limit_wait(self, execution: Execution, passed: RosStopwatch, times: int) -> None:
        over = partial(start_thread, f"limit of {execution.text}", self._wait_over, execution, passed, times)
        call_when_passed(WAIT_LIMIT, over)  # with a thread: an answer may wait for the knowledge

    def _wait_over(self, execution: Execution, passed: RosStopwatch, times: int) -> None:
        """Refuses an execution that waits for too long: what is in the way has had the robot's time to end.

        :param passed: since the wait began.
        :param times: how many limits of running time it may still last, with the one that has passed.
        """
        slow = times > 1 and passed.look() < ON_TIME * WAIT_LIMIT
        with self._changed:
            waits = execution.key in self._executions and execution.key not in self._book.running
            decisions = self._book.overdue(execution.key) if waits and not slow else []
        if waits and slow:
            self._limit_wait(execution, passed, times - 1)
        self._carry_out(decisions)

    def _spawn(self, execution: Execution) -> None:
        execution.left_queue.set()
        try:
            start_thread(f"run {execution.text}", self._live, execution)
        except RuntimeError as error:
            self._end(execution, Ending(False, f"{self.operator} cannot begin: {error}", begun=False))

    def _live(self, execution: Execution) -> None:
        """The life of an execution, in a thread of its own."""
        ending = Ending(False, "its action interface has failed")
        try:
            ending = self._run_with_effects(execution)
        except BaseException:  # whatever it is, the dispatcher gets its answer
            ending = Ending(False, log_failure(execution.text))
        finally:
            self._end(execution, ending)

    def _end(self, execution: Execution, ending: Ending) -> None:
        execution.left_queue.set()
        with self._changed:
            self._executions.pop(execution.key, None)
        ownership.resume(execution.token)
        self._owners.forget(execution.lease)
        try:
            if not execution.answered:
                self._answer_end(execution, ending)
        finally:  # the next execution begins whatever became of this answer
            with self._changed:
                decisions = self._book.end(execution.key)
                self._changed.notify_all()
            self._carry_out(decisions)

    def _answer_end(self, execution: Execution, ending: Ending) -> None:
        if not ending.succeeded:
            rospy.loginfo(f"{execution.text} did not succeed: {ending.reason}")
        execution.answered = True
        self._answer(execution.key, ending)

    def _run_with_effects(self, execution: Execution) -> Ending:
        missing = self.ready(execution)
        if missing is not None:
            return missing
        try:
            declared = self._declared(execution)
            self._allow(execution, declared)
            interrupted, counts = numeric_apart(declared.get(IF_INTERRUPTED, []))
            opening = Opening(
                execution.parameters,
                execution.token,
                rospy.get_name(),
                parse_literals(declared.get(WHILE_RUNNING, []), execution.binding),
                parse_literals(interrupted, execution.binding),
                [bound(text, execution.binding) for text in counts],
                execution.lane,
                list(declared.get(IF_STOPPED_AT, [])),
            )
            self._effects.open(opening)
        except _KNOWLEDGE_ERRORS as error:
            reason = f"the start effects, and what holds while it runs, could not be applied: {error}"
            ending = Ending(False, reason, begun=False)
            if not isinstance(error, ServiceUnavailable):
                return ending
            self._answer_end(execution, ending)  # they may be applied all the same, or will be
        else:
            ending = self._run_guarded(execution)
        try:
            self._effects.close(opening, closing_of(ending), lambda: self._unsettled(execution, ending))
        except _KNOWLEDGE_ERRORS as error:
            rospy.logerr(f"{execution.text}: {error}")
            return after_closing(ending, str(error))
        return ending

    def _unsettled(self, execution: Execution, ending: Ending) -> None:
        """The knowledge base is gone. That an action has stopped is true without it; a success is not."""
        if not ending.succeeded and not execution.answered:
            self._answer_end(execution, ending)

    def _run_guarded(self, execution: Execution) -> Ending:
        if execution.cancelled.is_set():
            return Ending(False, execution.cancel_reason, begun=False)
        try:
            return self.run(execution)
        except BaseException:  # user code may raise anything; the dispatcher still gets its answer
            return Ending(False, log_failure(execution.text))
        finally:
            execution.interruptible(None)

    def _lane(self, execution: Execution) -> str:
        """Executions of different lanes do not wait for each other; see :class:`.WorkBook`."""
        return ""

    def _param(self, execution: Execution) -> str:
        """Name of the parameters in which the host of an execution declares something."""
        return action_param(self.operator)

    def _allow(self, execution: Execution, declared: Dict[str, Any]) -> None:
        """Allows as many parallel executions as the action's class declares, and starts waiting ones."""
        if CONCURRENT in declared and not execution.lane:
            self._decide(lambda book: book.allow(at_once(declared[CONCURRENT])))

    def _declared(self, execution: Execution) -> Dict[str, Any]:
        """What the action's class declares; its host publishes it as parameters.

        All in one look-up: each costs a call to the master.
        """
        return dict(get_param(rospy.resolve_name(self._param(execution)), {}))

    def _answer(self, key: Key, ending: Optional[Ending] = None, **information: str) -> None:
        """Answers that an execution has ended; without an ending, that it is accepted, or goes on."""
        feedback = ActionFeedback(plan_id=key[0], action_id=key[1], status=ActionFeedback.ACTION_ENABLED)
        if ending is not None:
            succeeded = ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
            feedback.status = succeeded if ending.succeeded else ActionFeedback.ACTION_FAILED
            information = information_of(ending)
        feedback.information = [KeyValue(name, value) for name, value in information.items()]
        publish(self._feedback, feedback)

    def _announce(self) -> None:
        self._settle_left()
        # An announced interface is ready: every latched message of before has arrived.
        # rospy counts a connection before it is open, which a busy machine does much later.
        while not connected_peers(self._subscriber):
            if self._stopped.wait(CONNECTION_LOOK) or rospy.is_shutdown():
                return
        with self._changed:
            self._latched.connected = running_time()
        self._stopped.wait(LATCH_GRACE)
        # Wall time: a paused simulator must not make an interface look dead.
        self._announces = every(ANNOUNCE_PERIOD, self._greet)
        self._greet()

    def _greet(self) -> None:
        if self._announces is not None and not self._stopped.is_set():
            publish(self._announcements, self.formula)

    def _settle_left(self) -> None:
        """Closes what an earlier process of this node has left open, and answers for it."""
        try:
            when_back(self._settle)
        except _KNOWLEDGE_ERRORS as error:
            rospy.logerr(f"{self.operator}: {error}")

    def _settle(self) -> None:
        for key, text in settle_left(self.knowledge, self.operator):
            rospy.logwarn(f"{text} was running when this node ended; its knowledge is put right")
            reason = f"the action interface of {self.operator} was restarted while it ran"
            self._answer(key, Ending(False, reason))
