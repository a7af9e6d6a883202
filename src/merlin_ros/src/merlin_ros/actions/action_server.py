# SPDX-License-Identifier: Apache-2.0
"""The action server of MERLIN: actionlib's protocol, event-driven.

Differences from the stock server that clients can rely on: connections without Nagle's delay; status on wall
time, so that a stopped ``/clock`` does not look like a dead server, and less often while nothing happens;
callbacks run without a lock held, so a cancel callback may wait for what an execution holds; a goal whose
client leases it and dies is cancelled (:mod:`merlin_ros.actions.lease`); a server that has hung reads cancels
before it takes goals.
"""

import itertools
import math
import threading
import time
from collections import OrderedDict, deque
from typing import Any, Callable, Deque, Dict, List, Optional, Sequence, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from merlin_ros.actions.hang_watch import hangs
from merlin_ros.actions.lease import LASTING, LOSE_AFTER, LeaseChange, LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.actions.ownership import ownership
from merlin_ros.actions.peers import sender_of
from merlin_ros.actions.sending_order import SendingOrder
from merlin_ros.alarms import LEFT_OUT, Alarm, call_later, every
from merlin_ros.publishing import OnSubscriber, publish, unregister
from merlin_ros.work.threads import log_failure

STATUS_PERIOD = 0.2  # s of wall time, actionlib's usual 5 Hz
IDLE_BEATS = 2  # periods from one status to the next while no goal is open; the guard takes 1 s for silence
LIVELY = 2.0  # s after a change, or a client's connection, in which each period has a status all the same
BURST = 6  # changes in BURST_TIME of which each is published; further ones are, as one, behind that
BURST_TIME = 0.02  # s of wall time
KEEP_ENDED = 5.0  # s for which an ended goal stays in the status list
ENDED = 200  # of them at most, which each status list names: a flood of goals must not starve the others
RESULTS = 1000  # that wait for a connection: a cancel of all may end as many; rospy drops the oldest
KEEP_EARLY_CANCEL = 60.0  # s for which a cancel waits for the goal that it overtook
EARLY_CANCELS = 1000  # that wait at most; then the oldest is forgotten

_PENDING = (GoalStatus.PENDING, GoalStatus.RECALLING)
_numbers = itertools.count(1)


class ServerGoal:
    """A goal that a server received, and what becomes of it.

    The verbs that end it (:meth:`succeed`, :meth:`abort`, :meth:`cancelled`, :meth:`reject`) return False,
    and do nothing, when it has ended already: the first call decides.
    """

    def __init__(
        self, server: "ActionServer", goal_id: GoalID, goal: Any, sender: str = "", sent: int = 0
    ) -> None:
        self._server = server
        self.sent = sent  # when, as the server places its stamp
        self.sender = sender
        """The node that sent it; empty: not known."""
        self._status = GoalStatus(goal_id=goal_id, status=GoalStatus.PENDING)
        self.ended_at: Optional[float] = None  # monotonic, s
        self.goal = goal
        self.cancel_event = threading.Event()
        self.cancel_reason = "cancelled"
        """Why it shall stop, for its result."""
        self.unstopped = False  # what should stop it has raised

    @property
    def id(self) -> str:
        """The actionlib goal id."""
        return str(self._status.goal_id.id)

    @property
    def status(self) -> int:
        """A constant of actionlib_msgs/GoalStatus."""
        return int(self._status.status)

    @property
    def cancel_requested(self) -> bool:
        """Whether its cancel was requested."""
        return self.cancel_event.is_set()

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self.ended_at is not None

    def accept(self) -> bool:
        """Begins it: PENDING becomes ACTIVE, RECALLING becomes PREEMPTING."""
        with self._server.lock:
            if self.done or self.status not in _PENDING:
                return False
            pending = self.status == GoalStatus.PENDING
            self._status.status = GoalStatus.ACTIVE if pending else GoalStatus.PREEMPTING
            self._status.text = ""
            self._server.publish_status()
            return True

    def reject(self, result: Any = None, text: str = "") -> bool:
        """Ends the goal REJECTED; an accepted one ends ABORTED."""
        return self._end(GoalStatus.REJECTED if self.status in _PENDING else GoalStatus.ABORTED, result, text)

    def succeed(self, result: Any = None, text: str = "") -> bool:
        """Ends the goal SUCCEEDED."""
        return self._end(GoalStatus.SUCCEEDED, result, text)

    def abort(self, result: Any = None, text: str = "") -> bool:
        """Ends the goal ABORTED."""
        return self._end(GoalStatus.ABORTED, result, text)

    def cancelled(self, result: Any = None, text: str = "") -> bool:
        """Ends the goal RECALLED; an accepted one ends PREEMPTED."""
        return self._end(
            GoalStatus.RECALLED if self.status in _PENDING else GoalStatus.PREEMPTED, result, text
        )

    def tell(self, text: str) -> None:
        """Says in its status what it waits for; empty: for nothing."""
        with self._server.lock:
            if not self.done:
                self._status.text = text
                self._server.publish_status()

    def feedback(self, feedback: Any) -> None:
        """Publishes feedback to the client; nothing is sent after the end."""
        with self._server.lock:
            if not self.done:
                self._server.publish_feedback(self._status, feedback)

    def request_cancel(self, reason: str = "cancelled") -> bool:
        """Marks it as to be stopped; False when it was marked or ended before."""
        with self._server.lock:
            if self.done or self.cancel_event.is_set():
                return False
            self.cancel_reason = reason
            self._status.status = GoalStatus.RECALLING if self.status in _PENDING else GoalStatus.PREEMPTING
            self.cancel_event.set()
            self._server.publish_status()
            return True

    def _end(self, status: int, result: Any, text: str) -> bool:
        with self._server.lock:
            if self.done:
                return False
            self._status.status = status
            self._status.text = str(text)
            self.ended_at = time.monotonic()
            self._server.publish_result(self._status, result)
        self._server.ended(self)
        return True


class ActionServer:
    """Serves an action for any number of goals at a time.

    :param name: of the action; relative names and remapping as usual.
    :param action_spec: the generated ``...Action`` class.
    :param on_goal: called with each new :class:`ServerGoal` in the subscriber's thread; must not block, and
        has to accept or reject it, now or later.
    :param on_cancel: called once for each goal that shall stop, in the subscriber's thread, at once; in a
        thread of its own when its owner was lost. When it raises, the goal's status says so, and the next
        cancel of the goal calls it again.
    :param on_owner: called when the owner of a goal falls silent (SUSPENDED), is back (HELD) or is gone
        (LOST), with the goal, the state and the reason. Unless it returns False, SUSPENDED suspends what this
        process has sent on behalf of the goal, and LOST cancels the goal. None: always so.
    :param own_result: makes the result of a goal that this server itself ends, from its last status: one
        whose cancel overtook it, or that runs at :meth:`shutdown`. None of it: an empty one.
    :param lose_owner_after: s of its silence after which the owner of a goal counts as gone.
    """

    def __init__(
        self,
        name: str,
        action_spec: type,
        on_goal: Callable[[ServerGoal], None],
        on_cancel: Callable[[ServerGoal], None],
        on_owner: Optional[Callable[[ServerGoal, LeaseState, str], Optional[bool]]] = None,
        own_result: Callable[[GoalStatus], Any] = lambda status: None,
        lose_owner_after: float = LOSE_AFTER,
    ) -> None:
        self.name = rospy.resolve_name(name)
        action = action_spec()
        self._goal_type = type(action.action_goal)
        self._result_type = type(action.action_result)
        self._feedback_type = type(action.action_feedback)
        self._on_goal = on_goal
        self._on_cancel = on_cancel
        self._on_owner = on_owner
        self._own_result = own_result
        self._lose_owner_after = lose_owner_after
        self._leases: Optional[LeaseWatch] = None
        self.lock = threading.RLock()  # guards the goals and keeps results and statuses in order
        self._goals: Dict[str, ServerGoal] = {}
        self._early_cancels: OrderedDict[str, float] = OrderedDict()  # the oldest first
        self._order = SendingOrder()
        self._cancel_before = -math.inf  # goals sent until then are cancelled; in that order
        self._stopped = False
        self._published: Deque[float] = deque(maxlen=BURST)  # when statuses were, monotonic s
        self._lively_until = 0.0  # monotonic s
        self._idle_beats = 0  # since the last status
        self._postponed: Optional[Alarm] = None
        self._heartbeat: Optional[Alarm] = None
        self._subscribers: List[rospy.Subscriber] = []
        self._publishers: List[rospy.Publisher] = []

    def start(self, left: Sequence[Tuple[Any, str]] = ()) -> None:
        """Begins to serve.

        :param left: goal messages that an earlier process of this server has left and that are taken up
            again, and the node that has sent each.
        """
        goals = [ServerGoal(self, message.goal_id, message.goal, sender) for message, sender in left]
        self._goals.update((goal.id, goal) for goal in goals)
        listener = OnSubscriber(lambda _: self._stir())
        self._status_publisher = rospy.Publisher(
            self.name + "/status", GoalStatusArray, subscriber_listener=listener, latch=True, queue_size=50
        )
        self._result_publisher = rospy.Publisher(
            self.name + "/result", self._result_type, subscriber_listener=listener, queue_size=RESULTS
        )
        self._feedback_publisher = rospy.Publisher(
            self.name + "/feedback", self._feedback_type, queue_size=50
        )
        self._publishers = [self._status_publisher, self._result_publisher, self._feedback_publisher]
        self._leases = LeaseWatch(
            self.name + "/lease", self._owner_changed, lose_after=self._lose_owner_after
        )
        for goal in goals:
            self._call(goal)
        self._subscribers = [
            rospy.Subscriber(self.name + "/goal", self._goal_type, self._receive_goal, tcp_nodelay=True),
            rospy.Subscriber(self.name + "/cancel", GoalID, self._receive_cancel, tcp_nodelay=True),
        ]
        hangs.begin()
        self._heartbeat = every(STATUS_PERIOD, self._beat)

    def shutdown(self) -> None:
        """Ends every goal as ABORTED and stops serving."""
        with self.lock:
            self._stopped = True
        unregister(*self._subscribers)
        if self._leases is not None:
            self._leases.shutdown()
        for goal in self.goals():
            goal.abort(text="the action server shuts down")
        with self.lock:
            if self._postponed is not None:
                self.publish_status()
            if self._heartbeat is not None:
                self._heartbeat.cancel()
            unregister(*self._publishers)

    def goals(self) -> List[ServerGoal]:
        """The goals that have not ended, oldest first."""
        with self.lock:
            return [goal for goal in self._goals.values() if not goal.done]

    def ended(self, goal: ServerGoal) -> None:
        """A goal has ended; called once, without the lock unless its caller holds it."""
        if self._leases is not None:
            self._leases.forget(goal.id)
        ownership.resume(goal.id)

    def tell_owner(self, goal: ServerGoal) -> None:
        """Says once more how a goal is owned, unless its owner lives; see :meth:`LeaseWatch.tell`."""
        if self._leases is not None:
            self._leases.tell(goal.id)

    def publish_status(self) -> None:
        """Publishes the status list, in a burst of changes a little later; called with the lock held."""
        self._stir()
        self._publish_status()

    def _stir(self) -> None:
        """From now on the status comes often, for a while."""
        self._lively_until = time.monotonic() + LIVELY

    def _publish_status(self) -> None:
        now = time.monotonic()
        postponed = self._postponed
        burst = len(self._published) == BURST and now - self._published[0] < BURST_TIME
        if burst and not self._stopped and (postponed is None or postponed.waits):
            if postponed is None:
                self._postponed = call_later(self._published[0] + BURST_TIME - now, self._beat)
            return
        self._published.append(now)
        self._idle_beats = 0
        if postponed is not None:
            postponed.cancel()
            self._postponed = None
        ended = sorted((goal.ended_at, goal.id) for goal in self._goals.values() if goal.ended_at is not None)
        for number, (ended_at, goal_id) in enumerate(ended, ENDED - len(ended)):
            if number < 0 or now - ended_at > KEEP_ENDED:
                del self._goals[goal_id]
        while self._early_cancels and now - next(iter(self._early_cancels.values())) > KEEP_EARLY_CANCEL:
            self._early_cancels.popitem(last=False)
        message = GoalStatusArray(status_list=[goal._status for goal in self._goals.values()])
        message.header.stamp = rospy.Time.now()
        publish(self._status_publisher, message)

    def publish_result(self, status: GoalStatus, result: Any) -> None:
        """Publishes a result, then the status list; called with the lock held."""
        message = self._result_type(status=status)
        message.header.stamp = rospy.Time.now()
        result = self._own_result(status) if result is None else result
        if result is not None:
            message.result = result
        try:
            publish(self._result_publisher, message)
        except Exception as error:
            # What the server's code has put into it; the client gets its answer all the same. Generated code
            # raises what it stumbles over: a number too large for float32 is an OverflowError.
            status.status = GoalStatus.ABORTED
            status.text = f"the result cannot be sent: {error}"
            rospy.logerr(f"{self.name}: {status.text}")
            message.result = type(message.result)()
            publish(self._result_publisher, message)
        self.publish_status()

    def publish_feedback(self, status: GoalStatus, feedback: Any) -> None:
        """Publishes feedback on a goal; called with the lock held."""
        message = self._feedback_type(status=status, feedback=feedback)
        message.header.stamp = rospy.Time.now()
        publish(self._feedback_publisher, message)

    def _receive_goal(self, message: Any) -> None:
        hangs.wait_settled(lambda: self._stopped)
        with self.lock:
            if self._stopped:
                return
            goal_id = message.goal_id
            if not goal_id.id:
                goal_id.id = f"{rospy.get_name()}-unnamed-{next(_numbers)}"
            if goal_id.stamp.is_zero():
                goal_id.stamp = rospy.Time.now()
            sender = sender_of(message)
            known = self._goals.get(goal_id.id)
            lasting = goal_id.id.endswith(LASTING)  # who sends it again follows it, until it has ended
            if known is not None and not (lasting and known.done):
                # Its client gets the answers to the first one, as in actionlib.
                if known.sender != sender and not lasting:
                    rospy.logwarn(
                        f"{self.name}: a goal of {sender} is left out: its id {goal_id.id} is that of a goal "
                        f"of {known.sender}; each client has to make ids of its own"
                    )
                return
            self._order.look(rospy.Time.now().to_nsec())
            stamp = goal_id.stamp.to_nsec()
            goal = ServerGoal(self, goal_id, message.goal, sender, self._order.sent(stamp))
            self._goals[goal.id] = goal
            overtaken = self._early_cancels.pop(goal.id, None) is not None
            taken_back = overtaken or self._order.place(stamp) <= self._cancel_before
            if taken_back and lasting:  # it may be one that is looked for: its owner says what became of it
                goal.request_cancel()
            elif taken_back:
                goal.cancelled(text="cancelled before it arrived")
                return
            self.publish_status()
        if self._leases is not None:
            self._leases.arrive(goal.id)
        self._call(goal)
        self.tell_owner(goal)

    def _owner_changed(self, change: LeaseChange) -> None:
        with self.lock:
            goal = self._goals.get(change.goal)
        if goal is None or goal.done:
            return
        if self._on_owner is not None and self._on_owner(goal, change.state, change.reason) is False:
            return
        if change.state is LeaseState.HELD:
            ownership.resume(goal.id)
            return
        ownership.suspend(goal.id)
        if goal.done:  # it ended meanwhile, and nothing else would resume it
            ownership.resume(goal.id)
            return
        if change.state is LeaseState.LOST and self.cancel(goal, change.reason):
            rospy.logwarn(f"{self.name}: a goal is cancelled, {change.reason}")

    def _call(self, goal: ServerGoal) -> None:
        """Hands a goal to the server's owner; whatever that raises, the client gets an answer."""
        try:
            self._on_goal(goal)
        except BaseException:
            goal.abort(text=log_failure(self.name))

    def cancel(self, goal: ServerGoal, reason: str = "cancelled") -> bool:
        """Has a goal stopped; what raises has not stopped it, and is tried again with the next cancel.

        :return: whether it was to be stopped only now.
        """
        fresh = goal.request_cancel(reason)
        with self.lock:
            again, goal.unstopped = goal.unstopped and not goal.done, False
        if fresh or again:
            try:
                self._on_cancel(goal)
            except BaseException:
                goal.unstopped = True
                goal.tell(f"it is not stopped: {log_failure(f'{self.name}: {goal.id} is not stopped')}")
        return fresh

    def _receive_cancel(self, cancel: GoalID) -> None:
        with self.lock:
            self._order.look(rospy.Time.now().to_nsec())
            before = -math.inf if cancel.stamp.is_zero() else self._order.sent(cancel.stamp.to_nsec())
            everything = not cancel.id and cancel.stamp.is_zero()
            wanted = [
                goal
                for goal in self._goals.values()
                if not goal.done and (everything or goal.id == cancel.id or goal.sent <= before)
            ]
            if cancel.id and cancel.id not in self._goals:
                self._early_cancels[cancel.id] = time.monotonic()
                self._early_cancels.move_to_end(cancel.id)
                if len(self._early_cancels) > EARLY_CANCELS:
                    self._early_cancels.popitem(last=False)
            self._cancel_before = max(self._cancel_before, before)
        for goal in wanted:
            self.cancel(goal)

    def _beat(self) -> object:
        with self.lock:
            self._idle_beats += 1
            idle = time.monotonic() > self._lively_until and all(goal.done for goal in self._goals.values())
            if self._stopped or (idle and self._idle_beats < IDLE_BEATS):
                return LEFT_OUT
            self._publish_status()
        return None
