# SPDX-License-Identifier: Apache-2.0
"""The client side of an action, event-driven: goals, cancels, and servers that die.

actionlib's own client waits by polling, cannot tell a dead server and lets the kernel delay small packets.
Silence counts in looks of this process: one that was stalled itself does not take its servers for silent.
"""

import itertools
import queue
import select
import threading
import time
from typing import Any, Dict, List, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from smach.log import wake_at_shutdown
from smach_ros.waiting import OnSubscriber

GREETED = 0.5  # s of wall time after which the server sends over its link for results, without a proof
APART = 0.1  # s of wall time between two statuses that are that proof; rospy needs some ms
GONE = 1.0  # s of wall time without a connection to its status after which a server counts as dead
LONGEST_LOOK = 1.0  # s that one look at the clocks may count; states look every 0.5 s
SILENCE = 5.0  # s without a status, by the wall and by ROS time, after which a server counts as dead
LATE_RESULT = 3.0  # s of wall time that a result may come behind the status that announces it
REPEAT_CANCEL = 0.5  # s of wall time after which a cancel without effect is sent again
TERMINAL = (
    GoalStatus.PREEMPTED,
    GoalStatus.SUCCEEDED,
    GoalStatus.ABORTED,
    GoalStatus.REJECTED,
    GoalStatus.RECALLED,
    GoalStatus.LOST,
)
_CLOSED = select.POLLHUP | select.POLLERR | getattr(select, "POLLRDHUP", 0)
_numbers = itertools.count(1)


class SentGoal:
    """A goal that was sent. The connection's condition guards it."""

    def __init__(self, goal_id: str, now: Tuple[float, float]) -> None:
        self.id = goal_id
        self.status = GoalStatus.PENDING
        self.text = ""
        self.result: Any = None
        self.done = False
        self.sent = now  # wall, ROS, as the connection counts them
        self.seen = False
        self.ended: Optional[float] = None  # counted wall time of a terminal status
        self.end: Any = None  # that status
        self.cancelled: Optional[float] = None  # wall time of the last cancel


class ActionConnection:
    """Topics to one action server, shared by all states of the process that use it; see :meth:`acquire`."""

    _shared: Dict[Tuple[str, type], "ActionConnection"] = {}
    _shared_lock = threading.Lock()  # guards _shared, all _users and the begin of _releaser
    _unused: "queue.SimpleQueue[ActionConnection]" = queue.SimpleQueue()
    _releaser: Optional[threading.Thread] = None

    def __init__(self, name: str, action_spec: type) -> None:
        action = action_spec()
        self.name = name
        self._action_goal_type = type(action.action_goal)
        self._result_type = type(action.action_result.result)
        self._users = 0
        self.changed = threading.Condition(threading.RLock())  # guards the fields below
        wake_at_shutdown(self.changed)
        self._goals: Dict[str, SentGoal] = {}
        self._looked = time.monotonic(), rospy.get_time()
        self._counted = (0.0, 0.0)  # wall, ROS: s that passed in looks of this process
        self._status_at: Optional[Tuple[float, float]] = None  # counted
        self._server = ""
        self._stamp = rospy.Time()  # of the last goal that was sent, or that the server names
        self._result_link: Any = None  # the server's, at the last look
        self._linked_at = 0.0  # counted wall time of the first look at it
        self._proving: Any = None  # the server's link for results that was open when the last status came
        self._proving_since = 0.0  # counted wall time of the first status that came while it was open
        self._proved: Any = None  # that link, when another status has come at least APART later
        self._connected_at = 0.0  # counted
        changed = self.changed

        def wake(_: Any) -> None:
            with changed:
                changed.notify_all()

        listener = OnSubscriber(wake)
        self._goal_publisher = rospy.Publisher(
            name + "/goal", self._action_goal_type, listener, tcp_nodelay=True, queue_size=10
        )
        self._cancel_publisher = rospy.Publisher(
            name + "/cancel", GoalID, listener, tcp_nodelay=True, queue_size=10
        )
        self._result_subscriber = rospy.Subscriber(
            name + "/result", type(action.action_result), self._receive_result, tcp_nodelay=True
        )
        self._status_subscriber = rospy.Subscriber(
            name + "/status", GoalStatusArray, self._receive_status, tcp_nodelay=True
        )

    @classmethod
    def acquire(cls, name: str, action_spec: type) -> "ActionConnection":
        """The connection to an action; to be given back by :meth:`release`.

        :param name: resolved name of the action.
        """
        with cls._shared_lock:
            if cls._releaser is None:
                cls._releaser = threading.Thread(
                    target=cls._release_unused, name="action releases", daemon=True
                )
                cls._releaser.start()
            connection = cls._shared.get((name, action_spec))
            if connection is None:
                connection = cls._shared[name, action_spec] = cls(name, action_spec)
            connection._users += 1
            return connection

    def release_soon(self) -> None:
        """Ends the use from another thread; for the end of an object.

        The search for garbage may end it in the midst of rospy, in a thread that has rospy's locks.
        """
        self._unused.put(self)

    @classmethod
    def _release_unused(cls) -> None:
        while True:
            try:
                cls._unused.get().release()
            except Exception as error:  # the others are still to be released
                rospy.logwarn(f"A connection to an action server was not closed: {error!r}")

    def release(self) -> None:
        """Ends the use; the last one disconnects."""
        with self._shared_lock:
            self._users -= 1
            if self._users:
                return
            for key, connection in list(self._shared.items()):
                if connection is self:
                    del self._shared[key]
        for topic in (
            self._status_subscriber,
            self._result_subscriber,
            self._goal_publisher,
            self._cancel_publisher,
        ):
            topic.unregister()

    def ready(self) -> bool:
        """Whether a server is connected in all directions.

        A link for results counts when two statuses have come after it, `APART`: rospy's publisher greets a
        subscriber before it sends to it, also while a status goes out, so the result of a goal that is sent
        at once could be lost. While the clock of ROS stands no further status comes, and it counts after a
        while. Links to a process that has ended do not count: its successor has the same name.
        """
        server = self._server
        if not server:
            return False
        now, link = self._look()[0], _link_from(self._result_subscriber, server)
        if link is not self._result_link:
            self._result_link, self._linked_at = link, now
        return link is not None and all(
            (
                link is self._proved or now - self._linked_at >= GREETED,
                _reaches(self._goal_publisher, server),
                _reaches(self._cancel_publisher, server),
                _link_from(self._status_subscriber, server) is not None,
            )
        )

    def send(self, goal: Any) -> SentGoal:
        """Sends a goal.

        actionlib's SimpleActionServer refuses what is older than the goal that it took last: where the clock
        was set back, the stamp stays.
        """
        with self.changed:
            now, made = self._look(), rospy.Time.now()
            stamp = self._stamp = max(made, self._stamp)
        sent = SentGoal(f"{rospy.get_caller_id()}-smach-{next(_numbers)}-{made.secs}.{made.nsecs:09d}", now)
        message = self._action_goal_type(goal_id=GoalID(stamp=stamp, id=sent.id), goal=goal)
        message.header.stamp = stamp
        with self.changed:
            self._goals[sent.id] = sent
            self._goal_publisher.publish(message)
        return sent

    def cancel(self, goal: SentGoal) -> None:
        """Asks the server to stop a goal; its end is the answer."""
        with self.changed:
            if not goal.done:
                goal.cancelled = time.monotonic()
                self._cancel_publisher.publish(GoalID(id=goal.id))

    def repeat_cancel(self, goal: SentGoal) -> None:
        """Sends a cancel again that shows no effect: it travels beside the goal and may have come first."""
        if (
            goal.cancelled is not None
            and time.monotonic() - goal.cancelled > REPEAT_CANCEL
            and goal.status in (GoalStatus.PENDING, GoalStatus.ACTIVE)
        ):
            self.cancel(goal)

    def settle(self, goal: SentGoal) -> None:
        """Ends a goal that the status calls ended and whose result was lost on its way.

        A server that has just been connected may send it before it knows that connection.
        """
        if goal.ended is not None and not goal.done and self._look()[0] - goal.ended > LATE_RESULT:
            rospy.logwarn(f"Action {self.name}: the result did not arrive; using an empty one")
            goal.status, goal.text = goal.end.status, goal.end.text
            goal.result, goal.done = self._result_type(), True
            self.forget(goal)

    def forget(self, goal: SentGoal) -> None:
        """Drops a goal: no state waits for it any more."""
        with self.changed:
            self._goals.pop(goal.id, None)

    def why_lost(self, goal: SentGoal) -> str:
        """Why the server will no longer answer, or an empty text."""
        wall, ros = self._look()
        if self._status_subscriber.get_num_connections():
            self._connected_at = wall
        if wall - max(self._connected_at, goal.sent[0]) > GONE:
            return f"the action server {self.name} is gone"
        heard = self._status_at or (0.0, 0.0)
        # A paused simulator silences servers that live by its clock: both clocks must have gone on.
        silent = min(wall - max(heard[0], goal.sent[0]), ros - max(heard[1], goal.sent[1]))
        if silent > SILENCE:
            return f"the action server {self.name} has been silent for {silent:.1f} s"
        if not goal.seen and min(wall - goal.sent[0], ros - goal.sent[1]) > SILENCE:
            return f"the action server {self.name} never acknowledged the goal"
        return goal.text if goal.status == GoalStatus.LOST else ""

    def _look(self) -> Tuple[float, float]:
        """Wall and ROS time, s, without what this process has missed; called with the condition held."""
        wall, ros = time.monotonic(), rospy.get_time()
        steps = (wall - self._looked[0], ros - self._looked[1])  # the ROS clock may be set back
        self._looked = wall, ros
        wall_step, ros_step = (min(max(0.0, step), LONGEST_LOOK) for step in steps)
        self._counted = self._counted[0] + wall_step, self._counted[1] + ros_step
        return self._counted

    def _receive_result(self, message: Any) -> None:
        with self.changed:
            goal = self._goals.pop(message.status.goal_id.id, None)
            if goal is not None:
                goal.status, goal.text = message.status.status, message.status.text
                goal.result, goal.done = message.result, True
                self.changed.notify_all()

    def _receive_status(self, message: GoalStatusArray) -> None:
        with self.changed:
            self._server = message._connection_header["callerid"]
            self._stamp = max([self._stamp, *(status.goal_id.stamp for status in message.status_list)])
            self._status_at = self._look()
            link = _link_from(self._result_subscriber, self._server)
            if link is not self._proving:
                self._proving, self._proving_since = link, self._status_at[0]
            elif self._status_at[0] - self._proving_since >= APART:
                self._proved = link
            lost: List[SentGoal] = []
            if self._goals:
                known = {status.goal_id.id: status for status in message.status_list}
                for goal in self._goals.values():
                    status = known.get(goal.id)
                    if status is None:
                        lost += [goal] if goal.seen and goal.ended is None else []
                        continue
                    goal.seen = True
                    if status.status in TERMINAL:
                        goal.ended, goal.end = goal.ended or self._status_at[0], status
                    else:
                        goal.status = status.status
            for goal in lost:
                goal.status = GoalStatus.LOST
                goal.text = f"the action server {self.name} no longer knows the goal; it was restarted"
            self.changed.notify_all()


def _reaches(publisher: rospy.Publisher, server: str) -> bool:
    links = list(publisher.impl.connections)
    return any(link.endpoint_id == server and _is_open(link) for link in links)


def _link_from(subscriber: rospy.Subscriber, server: str) -> Any:
    """The open link on which a server publishes, or None."""
    links = list(subscriber.impl.connections)
    return next((link for link in links if link.callerid_pub == server and _is_open(link)), None)


def _is_open(link: Any) -> bool:
    """Whether neither side has closed a connection; rospy's publisher notices it with its next message."""
    try:
        poll = select.poll()
        poll.register(link.socket, _CLOSED)
    except (TypeError, ValueError):  # it has no socket any more
        return False
    return not poll.poll(0)
