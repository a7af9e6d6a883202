# SPDX-License-Identifier: Apache-2.0
"""The action client of MERLIN: actionlib's protocol, event-driven, and aware of a server that died.

An action server that is killed never answers: its connections close and its status falls silent. This client
counts the silence (:mod:`.server_silence`) in running time (:mod:`merlin_ros.deadline`) and ends the goal as
LOST. A server that stays connected may only be waiting for a processor, and gets more time.

The client owns its goals (:mod:`.actions.lease`): it renews their lease, cancels what it gives up, and
cancels what an earlier process of its node has left at the server.

A goal is stamped no earlier than the last one of this process, and those that the server names: actionlib's
``SimpleActionServer`` refuses what is older than the goal that it took last, and a clock may be set back.
"""

import contextlib
import itertools
import math
import re
import threading
from typing import Any, Callable, ClassVar, Dict, List, Mapping, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from merlin_ros.actions.client_goal import TERMINAL, ClientGoal
from merlin_ros.actions.lease import LASTING, LEASED
from merlin_ros.actions.lease_holder import LIFE, LeaseHolder
from merlin_ros.actions.peers import address_over, connected_peers, link_from, reaches
from merlin_ros.actions.server_silence import CONNECTED_SILENCE, LOOK, ServerSilence
from merlin_ros.alarms import Alarm, TickClock, every
from merlin_ros.deadline import running_time
from merlin_ros.master import registration
from merlin_ros.publishing import OnSubscriber, publish, unregister
from merlin_ros.work.threads import CallQueue

REPEAT_CANCEL = 0.5  # s after which a cancel that shows no effect is sent again
KEEP_GIVEN_UP = 60.0  # s for which a goal that was given up is cancelled when the server names it again
SPEAKING = 2.0  # s since its last status within which a server is waited for beyond the time-out
GREETED = 0.5  # s of wall time after which the server sends over its link for results, without a proof
APART = 0.1  # s of running time between two statuses that are that proof; rospy needs some ms
CONNECTING = 10.0  # s of that: rospy tries a connection that failed again at growing intervals
ASKING = 1.0  # s of a wait after which the master is asked for the server; then after 2, 4 …
AHEAD = 1.0  # s that a stamp may be ahead of the clock before it is reported
QUEUE = 1000  # goals and cancels that wait for a connection; rospy drops the oldest, and says nothing
DEAD_OWNERS = 1000  # owners whose goals were given up that are remembered; then the oldest is forgotten

OWNER_OVER = "the goal on whose behalf it was sent is over"
_STOPPING = TERMINAL | {GoalStatus.PREEMPTING, GoalStatus.RECALLING}
_numbers = itertools.count(1)


class ActionClient:
    """Sends goals to one action server.

    :param name: of the action; relative names and remapping as usual.
    :param action_spec: the generated ``...Action`` class.
    """

    _stamps: ClassVar[Dict[str, Tuple[str, rospy.Time]]] = {}  # process and stamp of the last goal, by action
    _stamps_lock: ClassVar[threading.Lock] = threading.Lock()  # guards _stamps

    def __init__(self, name: str, action_spec: type) -> None:
        self.name, self.action_spec = rospy.resolve_name(name), action_spec
        action = action_spec()
        self._goal_type = type(action.action_goal)
        self._result_type = type(action.action_result.result)
        self._changed = threading.Condition()  # guards the fields below
        self._goals: Dict[str, ClientGoal] = {}
        self._last_status: Optional[float] = None
        self._unpublished = False  # whether the master knew no node that publishes the status
        self._server = ""  # name of the node that sent the last status
        self._header: Optional[Mapping[str, str]] = None  # of the connection over which it came
        self._result_link: Any = None  # the server's, at the last look
        self._linked = TickClock(longest=LOOK)  # since the first look at it
        self._proving: Any = None  # the server's link for results that was open when the last status came
        self._proving_since = 0.0  # running time of the first status that came while it was open
        self._proved: Any = None  # that link, when another status has come at least APART later
        self._silence = ServerSilence(self.name, running_time)
        self._given_up: Dict[str, float] = {}  # goal id -> running time of the last cancel
        self._dead_owners: Dict[str, None] = {}  # the oldest first
        self._stopped = False
        self._looks: Optional[Alarm] = None
        self._late = CallQueue(f"client of {self.name}")  # what a look has found
        self._questions = CallQueue(f"server of {self.name}")  # to the master, which may hang
        self._node = rospy.get_name()
        self._own_ids = re.compile(rf"{re.escape(self._node)}-([0-9a-f]{{12}})-\d+-\d+\.\d+{LEASED}")
        self._taken = rospy.Time()  # the latest stamp of a goal in the last status list
        self._lease = LeaseHolder(self.name + "/lease")
        listener = OnSubscriber(lambda _: self._wake())
        self._goal_publisher = rospy.Publisher(
            self.name + "/goal", self._goal_type, subscriber_listener=listener, queue_size=QUEUE
        )
        self._cancel_publisher = rospy.Publisher(
            self.name + "/cancel", GoalID, subscriber_listener=listener, queue_size=QUEUE
        )
        # The status comes last: its callback, which may run at once, looks at the link for results.
        self._result_subscriber = rospy.Subscriber(
            self.name + "/result", type(action.action_result), self._receive_result, tcp_nodelay=True
        )
        self._subscribers = [
            self._result_subscriber,
            rospy.Subscriber(
                self.name + "/feedback",
                type(action.action_feedback),
                self._receive_feedback,
                tcp_nodelay=True,
            ),
            rospy.Subscriber(self.name + "/status", GoalStatusArray, self._receive_status, tcp_nodelay=True),
        ]

    @property
    def alive(self) -> bool:
        """Whether a server is connected and not silent; see :attr:`missing`."""
        return not self.missing

    @property
    def heard(self) -> bool:
        """Whether a server was ever heard."""
        return self._last_status is not None

    @property
    def missing(self) -> str:
        """What keeps the server from being used, as part of a sentence; empty when nothing does.

        Its link for results counts when two statuses have come after it, `APART`: rospy's publisher greets a
        subscriber before it sends to it, also while a status goes out, so the result of a goal that is sent
        at once could be lost. While the clock of ROS stands, plain servers send no further status, and it
        counts after a while. The successor of a server that has died counts when it has spoken.
        """
        last = self._last_status
        if last is None:
            return "no node publishes its status" if self._unpublished else "its status was never heard"
        silent = running_time() - last
        if silent >= CONNECTED_SILENCE:
            return f"it has been silent for {silent:.1f} s"
        if not address_over(self._subscribers[-1], self._header):
            return "its process is gone"
        links = {
            "goals": reaches(self._goal_publisher, self._server),
            "cancels": reaches(self._cancel_publisher, self._server),
            "results": self._takes_results(),
            "status and feedback": self._connected(),
        }
        lacking = next((name for name, there in links.items() if not there), "")
        return f"it speaks, but has no connection for {lacking}" if lacking else ""

    def absence(self, waited: float) -> str:
        """The reason of what failed for want of the server; the same words for the same cause.

        :param waited: s of running time.
        """
        why = f" ({self.missing})" if self._last_status is None else ""
        return f"no action server {self.name} within {waited:g} s{why}"

    def _takes_results(self) -> bool:
        """Whether the server sends over its link for results."""
        with self._changed:
            link = link_from(self._result_subscriber, self._server)
            if link is not self._result_link:
                self._result_link, self._linked = link, TickClock(longest=LOOK)
            self._linked.look()
            return link is not None and (link is self._proved or self._linked.now >= GREETED)

    def wait_for_server(
        self, timeout: Optional[float] = None, unless: Callable[[], bool] = lambda: False
    ) -> bool:
        """Waits until a server is connected both ways.

        :param timeout: s of running time; None: until ROS shuts down. A server that speaks meanwhile, and
            whose connections are not complete, gets `CONNECTING` more; not with 0, which is one look.
        :param unless: ends the wait when it is true.
        """
        shortest = math.inf if timeout is None else timeout
        longest = shortest + CONNECTING if timeout else shortest
        ticks, asks = TickClock(running_time), ASKING
        with self._changed:
            while not self.alive:
                ticks.look()
                if ticks.now >= asks:
                    asks *= 2.0
                    self._questions.put(self._ask_master)
                left = shortest - ticks.now
                if left <= 0.0 and running_time() - (self._last_status or -SPEAKING) < SPEAKING:
                    left = longest - ticks.now
                if left <= 0.0 or rospy.is_shutdown() or self._stopped or unless():
                    return False
                # rospy announces a connection of our publishers, but not one of our subscribers.
                self._changed.wait(min(left, 0.01))
        return True

    def send(
        self,
        goal: Any,
        on_done: Optional[Callable[[ClientGoal], None]] = None,
        on_feedback: Optional[Callable[[ClientGoal, Any], None]] = None,
        owner: Optional[str] = None,
        lasting: bool = False,
        again: str = "",
    ) -> ClientGoal:
        """Sends a goal.

        :param lasting: it goes on without this client, which does not lease it, nor cancels it when it is
            lost or when this process ends.
        :param again: id of a lasting goal that was sent before: a server that has it answers that one.
        :param owner: id of the goal of this process's own server on whose behalf it is sent; None: of any.
        :param on_done: called once with the ended goal, in a thread of this client; must not block.
        :param on_feedback: called with the goal and each feedback, likewise.
        """
        now = rospy.Time.now()
        process = getattr(link_from(self._result_subscriber, self._server), "endpoint_id", "")
        with self._stamps_lock:
            served, last = self._stamps.get(self.name, ("", now))
            if process and served and process != served:
                last = now  # a server that was started anew has taken none
            stamp = max(now, self._taken, last)
            self._stamps[self.name] = process or served, stamp
        if (stamp - now).to_sec() > AHEAD:
            rospy.logwarn_throttle(
                60.0,
                f"{self.name} has taken a goal that is stamped {(stamp - now).to_sec():.0f} s ahead of this "
                "clock, which was set back or is behind: further goals get that stamp until it has caught up",
            )
        how = LASTING if lasting else LEASED
        name = f"{self._node}-{LIFE}-{next(_numbers)}-{now.secs}.{now.nsecs:09d}{how}"
        goal_id = GoalID(stamp=stamp, id=again or name)
        with self._changed:
            sent = ClientGoal(goal_id, self._send_cancel, on_done, on_feedback, owner, self._silence.look())
        message = self._goal_type(goal_id=goal_id, goal=goal)
        message.header.stamp = now
        if not sent.lasting:
            self._lease.hold(sent.id, owner)
        with self._changed:
            over = owner is not None and owner in self._dead_owners
            if not over:
                sent.earlier = self._goals.get(sent.id)
                self._goals[sent.id] = sent
            if self._looks is None:
                self._looks = every(LOOK, self._look)
        if over:
            self._lease.release(sent.id)
            sent.finish(GoalStatus.LOST, OWNER_OVER, self._result_type())
            return sent
        try:
            publish(self._goal_publisher, message)
        except BaseException:  # it was not sent, and its sender learns that from this
            with self._changed:
                if self._goals.get(sent.id) is sent:
                    del self._goals[sent.id]
                    if sent.earlier is not None:
                        self._goals[sent.id] = sent.earlier
            self._lease.release(sent.id)
            raise
        return sent

    def hand_over(self, goal: ClientGoal, owner: str) -> None:
        """From now on a goal runs on behalf of another goal of this process's own server."""
        with self._changed:
            if goal.id in self._goals and goal.owner != owner:  # one that has ended is leased no more
                goal.owner = owner
                self._lease.hold(goal.id, owner)

    def give_up(self, goal: ClientGoal, why: str) -> None:
        """Ends a goal as LOST here; the server is asked to stop it, and it no longer has an owner."""
        with self._changed:
            known = self._goals.pop(goal.id, None)
        if known is not None:
            self._lose(known, why)

    def give_up_owned(self, owner: str) -> None:
        """Gives up all that was sent on behalf of a goal, and all that still will be."""
        with self._changed:
            self._dead_owners[owner] = None
            if len(self._dead_owners) > DEAD_OWNERS:
                del self._dead_owners[next(iter(self._dead_owners))]
            goals = [goal for goal in self._goals.values() if goal.owner == owner]
        for goal in goals:
            self.give_up(goal, OWNER_OVER)

    def shutdown(self) -> None:
        """Disconnects; goals that still run end as LOST here, and the server is asked to stop them."""
        with self._changed:
            self._stopped = True
            goals = list(self._goals.values())
            self._goals.clear()
            self._changed.notify_all()
        for goal in goals:
            if not goal.lasting:
                self._publish_cancel(goal.id)
        self._lease.shutdown()
        unregister(*self._subscribers, self._goal_publisher, self._cancel_publisher)
        for goal in goals:
            goal.finish(GoalStatus.LOST, "the client was shut down", self._result_type())

    def _ask_master(self) -> None:
        """Connects to a server of which the master's word was lost; a connection that there is stays."""
        with contextlib.suppress(*registration.ERRORS):  # the wait goes on, and says what it lacks
            for subscriber in self._subscribers:
                if self._stopped or rospy.is_shutdown():
                    return
                publishers = registration.subscribe_again(subscriber.resolved_name, subscriber.type)
            self._unpublished = not publishers  # the status comes last

    def _wake(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def _connected(self) -> bool:
        # The server's node, not any: a guard and a recorder subscribe to goals and cancels, too.
        return bool(
            self._goal_publisher.impl.has_connection(self._server)
            and self._cancel_publisher.impl.has_connection(self._server)
            and all(subscriber.get_num_connections() for subscriber in self._subscribers)
        )

    def _send_cancel(self, goal: ClientGoal) -> None:
        with self._changed:
            self._goals.get(goal.id, goal).cancel_sent = running_time()
            self._changed.notify_all()
        self._publish_cancel(goal.id)

    def _receive_result(self, message: Any) -> None:
        status = message.status
        with self._changed:
            goal = self._goals.pop(status.goal_id.id, None)
            if goal is not None:
                self._silence.settle(goal)
        if goal is None:
            return
        if status.status not in TERMINAL:  # the server may go on with it
            said = f": {status.text}" if status.text else ""
            why = f"sent a result with status {status.status}, which is not an end{said}"
            self._lose(goal, f"the action server {self.name} {why}")
        else:
            at = message.header.stamp.to_sec() or math.nan
            try:
                goal.finish(status.status, status.text, message.result, at)
            finally:  # what comes next does not wait for it
                self._lease.release(goal.id)

    def _receive_feedback(self, message: Any) -> None:
        with self._changed:
            goal = self._goals.get(message.status.goal_id.id)
        if goal is not None:
            goal.take_feedback(message.feedback)

    def _receive_status(self, message: GoalStatusArray) -> None:
        statuses = {status.goal_id.id: status for status in message.status_list}
        with self._changed:
            now = running_time()
            self._last_status = now
            self._taken = max((status.goal_id.stamp for status in message.status_list), default=rospy.Time())
            self._header = message._connection_header
            self._server = message._connection_header["callerid"]
            link = link_from(self._result_subscriber, self._server)
            if link is not self._proving:
                self._proving, self._proving_since = link, now
            elif now - self._proving_since >= APART:
                self._proved = link
            left = self._left_running(statuses, now)
            lost = self._silence.hear(statuses, self._goals.values())
            for goal in lost:
                del self._goals[goal.id]
            self._changed.notify_all()
        for goal_id in left:
            self._publish_cancel(goal_id)
        for goal in lost:
            self._lose(goal, f"the action server {self.name} forgot the goal; it restarted")

    def _left_running(self, statuses: Dict[str, GoalStatus], now: float) -> List[str]:
        """Goals that run at the server and that nothing here waits for; called with the lock held.

        Those that were given up, and those of an earlier process of this node: rospy names are unique. Other
        clients of this process send goals, too, plain ones of actionlib among them: their ids have no life.
        """
        for goal_id, since in list(self._given_up.items()):
            if goal_id not in statuses and now - since > KEEP_GIVEN_UP:
                del self._given_up[goal_id]
        found = []
        for goal_id, status in statuses.items():
            if status.status in _STOPPING or goal_id in self._goals:
                continue
            ours = self._own_ids.fullmatch(goal_id)
            if (ours is not None and ours[1] != LIFE) or goal_id in self._given_up:
                last = self._given_up.get(goal_id)
                if last is None or now - last > REPEAT_CANCEL:
                    self._given_up[goal_id] = now
                    found.append(goal_id)
        return found

    def _lose(self, goal: ClientGoal, why: str) -> None:
        """Gives a goal up that was taken from the list; without the lock."""
        if not goal.lasting:
            with self._changed:
                self._given_up[goal.id] = running_time()
            self._publish_cancel(goal.id)
            self._lease.release(goal.id)
        goal.finish(GoalStatus.LOST, why, self._result_type())

    def _publish_cancel(self, goal_id: str) -> None:
        # Never with a stamp: a server would also cancel every goal sent in the same tick of the clock.
        with contextlib.suppress(rospy.ROSException):  # the client was shut down meanwhile
            publish(self._cancel_publisher, GoalID(id=goal_id))

    def _look(self) -> None:
        """Ends goals whose server is silent and repeats cancels that got lost."""
        with self._changed:
            if self._looks is not None and (self._stopped or not self._goals):  # until the next goal
                self._looks.cancel()
                self._looks = None
                return
            now = running_time()
            self._silence.look()
            publishes, connected = bool(connected_peers(self._subscribers[-1])), self._connected()
            if not publishes:
                self._silence.part(self._goals.values())
            for goal in list(self._goals.values()):
                why = self._silence.why_lost(goal, publishes, connected)
                if why:
                    del self._goals[goal.id]
                    goal.hangs = connected and self._silence.silent(goal) > CONNECTED_SILENCE
                    self._late.put(self._lose, goal, why)
                elif (
                    goal.cancel_sent is not None
                    and now - goal.cancel_sent > REPEAT_CANCEL
                    and goal.status not in (GoalStatus.PREEMPTING, GoalStatus.RECALLING)
                ):
                    self._late.put(self._send_cancel, goal)
