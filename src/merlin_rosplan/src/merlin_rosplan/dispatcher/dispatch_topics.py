# SPDX-License-Identifier: Apache-2.0
"""The world as a dispatch sees it: topics to publish on, a knowledge base, interfaces to listen for."""

import functools
import threading
import time
from typing import (
    TYPE_CHECKING,
    Any,
    Callable,
    Dict,
    FrozenSet,
    Iterable,
    List,
    Mapping,
    Optional,
    Sequence,
    Set,
    Tuple,
)

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import DispatchStatus, KnowledgeChanges, RobotHost, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import DomainFormula, KnowledgeItem, StatusUpdate

from merlin_pddl.breakpoints import Breakpoints
from merlin_planning.action_messages import OWN_MARK
from merlin_planning.dispatch_progress import CANCEL_ACTION
from merlin_planning.foreign_changes import ForeignChanges
from merlin_planning.robot_roster import RobotRoster
from merlin_ros.actions.lease_holder import LeaseHolder
from merlin_ros.actions.peers import address_over, reaches, sender_of
from merlin_ros.deadline import Deadline, LookedAt, running_time
from merlin_ros.publishing import publish
from merlin_ros.robot_values import AVAILABLE
from merlin_ros.ros_alarm import RosAlarm, RosStopwatch
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchEnvironment,
    DispatchError,
    DispatchReport,
    DispatchState,
    FeedbackStatus,
    KnowledgeChanged,
    PlanGoals,
    PlanKnowledgeError,
)
from merlin_rosplan.dispatch.dispatch_schedule import BindingError, PlannedAction
from merlin_rosplan.dispatch.interface_watch import InterfaceWatch
from merlin_rosplan.transport.component import Component

if TYPE_CHECKING:  # imported when there is a plan
    from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm
    from merlin_rosplan.dispatcher.plan_knowledge import PlanKnowledge
    from merlin_rosplan.knowledge.transaction import StateChange

SHUTDOWN_DEADLINE = 1.0  # s that running interfaces get to answer when the node ends
_GOES_ON = (DispatchState.RUNNING, DispatchState.CANCELLING)


class DispatchTopics(DispatchEnvironment):
    """Publishes for one dispatcher and answers its dispatches.

    :param component: whose names and parameters these are.
    :param knowledge: gives what is asked.
    :param publishes_feedback: whether the dispatcher publishes feedback of its own (the simple one does).
    :param on_tick: called when a time asked for has come.
    :param on_feedback: called with each feedback the dispatcher publishes.
    :param on_change: called at each change of a dispatch.
    :param breakpoints: of the dispatcher, published in its status.
    """

    def __init__(
        self,
        component: Component,
        knowledge: Callable[[], "PlanKnowledge"],
        publishes_feedback: bool,
        on_tick: Callable[[], None],
        on_feedback: Callable[[ActionFeedback], None],
        on_change: Callable[[], None],
        breakpoints: Breakpoints,
    ) -> None:
        self._component = component
        self._knowledge = knowledge
        self._on_feedback = on_feedback
        self._on_change = on_change
        self._breakpoints = breakpoints
        self._telling = threading.Lock()  # keeps statuses in order; guards the two fields below
        self._reported = DispatchReport(DispatchState.IDLE, "nothing dispatched yet")
        self._shown: Dict[int, RunningAction] = {}  # made once each: a status names all that run
        # Interfaces latch their last feedback: an id from an earlier process of this node must not fit again.
        self.plan_id = int(time.time()) % 1_000_000 * 1000
        self._operators: Dict[str, ActionModel] = {}
        self._interfaces = InterfaceWatch(running_time)
        self._lease = component.own(LeaseHolder(component.resolve("lease")))
        self._leased: Set[str] = set()
        self._owner = ""
        self._takers: Dict[int, Callable[[], bool]] = {}  # whether they are still connected, by action
        self._open_lock = threading.Lock()  # guards _open
        self._open: Dict[int, PlannedAction] = {}
        self._alarm = component.own(RosAlarm(on_tick, f"alarm of {component.scope}"))
        self._born, self._passed = rospy.get_time(), RosStopwatch()
        topic = str(component.param("action_dispatch_topic", "action_dispatch"))
        # Latched as in ROSPlan; its queue of one would lose actions and cancels sent back to back.
        self._actions = component.publisher(topic, ActionDispatch, queue_size=1000, latch=True)
        # What an earlier process of this node has dispatched is no longer latched; this says so.
        publish(self._actions, ActionDispatch(name=CANCEL_ACTION, action_id=-1, plan_id=self.plan_id))
        self._feedback: Optional[rospy.Publisher] = None
        if publishes_feedback:
            topic = str(component.param("action_feedback_topic", "action_feedback"))
            self._feedback = component.publisher(topic, ActionFeedback, queue_size=1000, latch=True)
        self._status = component.publisher("dispatch_status", DispatchStatus, queue_size=100, latch=True)
        self.repeat_status()
        component.subscriber(
            f"{component.knowledge_base}/pddl_action_parameters",
            DomainFormula,
            lambda message: self._interfaces.announce(message.name),
        )
        self._robots = RobotRoster()  # of which a host was heard
        component.subscriber(f"{component.knowledge_base}/robots", RobotHost, self._meet)

    def begin(self, owner: str = "") -> int:
        """Another dispatch begins; returns its plan id.

        :param owner: id of its goal: while the owner of that one is silent, its actions are suspended.
        """
        self._operators.clear()
        self._takers.clear()
        with self._telling:
            self._shown.clear()
        with self._open_lock:
            self._open.clear()
        self.plan_id += 1
        self._owner = owner or f"{self._component.scope} {self.plan_id}"  # not the goals of others
        return self.plan_id

    def taken(self, message: ActionFeedback, topic: rospy.Subscriber) -> None:
        """An interface has taken an action; from any thread.

        :param topic: on which it said so.
        """
        header = getattr(message, "_connection_header", None)
        address = address_over(topic, header)  # a connection that was cut may be made anew
        self._takers[message.action_id] = functools.partial(reaches, topic, address)

    def has_left(self, action: PlannedAction) -> bool:
        """Looks at the connections to the process that has taken the action."""
        connected = self._takers.get(action.id)
        return connected is not None and not connected()

    def answered(self, action_id: int) -> None:
        """An interface has given its final answer; from any thread."""
        with self._open_lock:
            self._open.pop(action_id, None)

    def unanswered(self) -> List[PlannedAction]:
        """The actions of this dispatch whose interfaces have not given a final answer."""
        with self._open_lock:
            return list(self._open.values())

    def now(self) -> float:
        """ROS time as it passes, s, from when the node began."""
        return self._born + self._passed.look()

    def deadline(self, seconds: Optional[float]) -> Deadline:
        """A deadline that stands still while the simulator is paused, and while this process is stalled."""
        return LookedAt(SHUTDOWN_DEADLINE if self._component.closed and seconds is None else seconds)

    def send(self, action: PlannedAction) -> None:
        """Publishes the action. Its lease follows with the next report: robots wait for the action."""
        message, now = self.message(action, action.name), rospy.Time.now()
        with self._telling:
            shown = RunningAction(action.id, self.plan_id, action.name, message.parameters, now, False)
            self._shown.setdefault(action.id, shown)  # one that is sent again has begun before
        with self._open_lock:
            self._open[action.id] = action
        publish(self._actions, message)

    def send_cancel(self, action: PlannedAction) -> None:
        """Publishes ``cancel_action`` for the action."""
        publish(self._actions, self.message(action, CANCEL_ACTION))

    def publish_feedback(self, action: PlannedAction, status: FeedbackStatus) -> None:
        """Publishes feedback of our own, marked as such."""
        if self._feedback is None:
            return
        message = ActionFeedback(
            action_id=action.id,
            plan_id=self.plan_id,
            status=int(status),
            information=[KeyValue(key=OWN_MARK, value=self._component.scope)],
        )
        publish(self._feedback, message)
        self._on_feedback(message)

    def operator(self, action: PlannedAction) -> "ActionModel":
        """The ground operator; asks the knowledge base once per operator and plan."""
        try:
            operator = self._operators.get(action.name)
            if operator is None:
                operator = self._operators[action.name] = self._knowledge().operator(action.name)
            arguments = [value for _, value in action.parameters]
            return operator.ground(operator.bind(arguments, action.duration))
        except (PlanKnowledgeError, BindingError) as error:
            raise DispatchError(f"{action} cannot be dispatched: {error}") from error

    def false_of_each(self, asked: "Sequence[Tuple[PlannedAction, Conditions]]") -> "List[Conditions]":
        """Asks the knowledge base, in one call."""
        try:
            return self._knowledge().false_of_each([conditions for _, conditions in asked])
        except PlanKnowledgeError as error:
            actions = ", ".join(str(action) for action, _ in asked[:5])
            raise DispatchError(f"the conditions of {actions} cannot be checked: {error}") from error

    def next_change(self, names: FrozenSet[str], until: float) -> Optional[float]:
        """Asks the knowledge base for what it waits for."""
        try:
            changes = self._knowledge().timed_changes()
        except PlanKnowledgeError as error:
            raise DispatchError(f"timed knowledge cannot be asked for: {error}") from error
        now = self.now()
        moved = now - rospy.get_time()  # by what the clock was set
        times = (time + moved for time, name in changes if name in names)
        return max((time for time in times if now < time <= until), default=None)

    def held(self) -> "Optional[Mapping[int, FrozenSet[PlanTerm]]]":
        """Asks a knowledge base of ours for its open executions."""
        return self._knowledge().held(self.plan_id)

    def goals(self) -> Optional[PlanGoals]:
        """Asks the knowledge base."""
        return self._knowledge().goals()

    def goals_hold(self) -> bool:
        """Asks the knowledge base."""
        return self._knowledge().goals_hold()

    def objects(self) -> Optional[FrozenSet[str]]:
        """Asks the knowledge base."""
        return self._knowledge().objects()

    def robot_left(self, action: PlannedAction, unmet: "Conditions") -> str:
        """The robot of the action whose ``(available ?robot)`` does not hold; the bridges keep that fact."""
        named = {value.lower() for _, value in action.parameters if value.lower() in self._robots}
        lacking = [
            atom.arguments[0]
            for atom in unmet.positive
            if atom.name.lower() == AVAILABLE and len(atom.arguments) == 1
        ]
        return next((robot for robot in lacking if robot.lower() in named), "")

    def _meet(self, word: RobotHost) -> None:
        admission = self._robots.admit(word.robot.lower(), sender_of(word), time.monotonic())
        if admission.refusal:
            rospy.logwarn(admission.refusal)

    def seconds_silent(self, operator: str) -> Optional[float]:
        """Seconds since the operator's interface announced itself."""
        return self._interfaces.seconds_silent(operator)

    def just_announced(self, operator: str) -> bool:
        """Whether the operator's interface has just started."""
        return self._interfaces.just_announced(operator)

    def wake_at(self, when: Optional[float]) -> None:
        """Sets the alarm."""
        if when is None:
            self._alarm.set(None)
        else:
            self._alarm.set_after(when - self.now())

    def changed(self, report: DispatchReport) -> None:
        """Publishes the status while a dispatch runs; the end is published after the goals have been checked.

        Leases what runs, and lets go of what runs no more: an interface that did not answer stops by itself.
        """
        running = {f"{self.plan_id}/{action.id}" for action in report.running}
        if report.state in _GOES_ON:
            running.add(f"{self.plan_id}/plan")  # between two actions the client must see its life, too
        if running != self._leased:
            self._lease.exchange(running - self._leased, self._leased - running, self._owner)
            self._leased = running
        if report.state in _GOES_ON:
            self.report_status(report)
        self._on_change()

    def message(self, action: PlannedAction, name: str) -> ActionDispatch:
        """An action as it is dispatched under a name."""
        return ActionDispatch(
            action_id=action.id,
            plan_id=self.plan_id,
            name=name,
            parameters=[KeyValue(key=label, value=value) for label, value in action.parameters],
            duration=action.duration,
            dispatch_time=action.time,
        )

    def report_status(self, report: DispatchReport) -> None:
        """Publishes how a dispatch stands; one that has ended is idle."""
        with self._telling:
            self._reported = report
            self._publish_status(report)

    def repeat_status(self) -> None:
        """Publishes the last status with the breakpoints as they are now; from any thread."""
        with self._telling:
            self._publish_status(self._reported)

    def _publish_status(self, report: DispatchReport) -> None:
        status = DispatchStatus(
            state=int(report.state) if report.state in _GOES_ON else DispatchStatus.IDLE,
            plan_id=self.plan_id,
            running=[self._shown[action.id] for action in report.running if action.id in self._shown],
            steps_done=report.steps_done,
            steps_total=report.steps_total,
            failed_action=str(report.failed_action) if report.failed_action is not None else "",
            reason=report.reason,
            unanswered=[str(action) for action in report.unanswered],
            goal_achieved=report.goal_achieved,
            unmet_goals=list(report.unmet_goals),
            breakpoints=self._breakpoints.texts,
            held=self._breakpoints.held,
        )
        status.header.stamp = rospy.Time.now()
        publish(self._status, status)


class KnowledgeEvents:
    """Tells one dispatcher what has changed; in the same process without ROS.

    A message to its own process takes two changes of thread, beside the answer of the interface that has made
    the change: robots wait for the dispatch.

    :param component: the dispatcher.
    :param put: called with each event, in the thread that hears of the change.
    """

    def __init__(self, component: Component, put: Callable[[KnowledgeChanged], None]) -> None:
        self._put = put
        name = component.knowledge_base
        store = getattr(Component.in_process(name), "store", None)
        if store is not None:
            store.listen(self._changed)
            return
        self._changes = component.own(ForeignChanges(name, self._receive_changes, own=True))
        component.subscriber(f"{name}/status/update", StatusUpdate, self._receive_update)

    def _changed(self, change: "StateChange") -> None:
        from merlin_pddl.knowledge import Fact, Instance

        rows = (*change.added, *change.removed, *change.changed)
        facts = {row.key: False for row in change.removed if isinstance(row, Fact)}
        facts.update((row.key, not row.negative) for row in change.added if isinstance(row, Fact))
        self._tell(change.cleared, ("" if isinstance(row, Instance) else row.name for row in rows), facts)

    def _receive_changes(self, message: Optional[KnowledgeChanges]) -> None:
        if message is None:
            self._put(KnowledgeChanged())
            return
        items = (*message.added, *message.removed, *message.changed)
        facts = {_key(item): False for item in message.removed if item.knowledge_type == item.FACT}
        facts.update(
            (_key(item), not item.is_negative) for item in message.added if item.knowledge_type == item.FACT
        )
        self._tell(False, (item.attribute_name for item in items), facts)

    def _receive_update(self, _: StatusUpdate) -> None:
        # A knowledge base that publishes the changes themselves says there what they were.
        self._put(KnowledgeChanged(frozenset() if self._changes.connected else None))

    def _tell(self, cleared: Any, names: Iterable[str], facts: Dict[Tuple[str, ...], bool]) -> None:
        changed = None if cleared else frozenset(name.lower() for name in names)
        self._put(KnowledgeChanged(changed, frozenset(facts.items())))


def _key(item: KnowledgeItem) -> Tuple[str, ...]:
    return tuple(word.lower() for word in (item.attribute_name, *(value.value for value in item.values)))
