"""The action client of MERLIN: actionlib's protocol, event-driven, and aware of a server that died.

An action server that is killed never answers: its connections close and its status falls silent. This client
counts the silence in running time (:mod:`merlin_sm.deadline`) and ends the goal as LOST. A server that stays
connected may only be waiting for a processor, and gets more time.
"""

import itertools
import threading
from typing import Any, Callable, Dict, List, Optional

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray

from merlin_sm.deadline import Deadline, running_time

SILENCE = 3.0  # s of running time without status after which a server that is not connected counts as dead
CONNECTED_SILENCE = 15.0  # s of that after which one counts as dead that is
REPEAT_CANCEL = 0.5  # s after which a cancel that shows no effect is sent again
LATE_RESULT = 1.0  # s that a result may come behind the status that announces it

TERMINAL = frozenset(
    (
        GoalStatus.PREEMPTED,
        GoalStatus.SUCCEEDED,
        GoalStatus.ABORTED,
        GoalStatus.REJECTED,
        GoalStatus.RECALLED,
        GoalStatus.LOST,
    )
)
_numbers = itertools.count(1)


class ClientGoal:
    """A goal that was sent."""

    def __init__(
        self,
        client: "ActionClient",
        goal_id: GoalID,
        on_done: Optional[Callable[["ClientGoal"], None]],
        on_feedback: Optional[Callable[["ClientGoal", Any], None]],
    ) -> None:
        self._client = client
        self.goal_id = goal_id
        self.status = GoalStatus.PENDING
        self.text = ""
        self.result: Any = None
        self.feedback: Any = None
        self._on_done = on_done
        self._on_feedback = on_feedback
        self._ended = threading.Event()
        self.sent = running_time()
        self.seen = False  # in a status list of the server
        self.ended_on_server: Optional[float] = None  # running time of the terminal status
        self.cancel_sent: Optional[float] = None  # running time of the last cancel

    @property
    def id(self) -> str:
        """The actionlib goal id."""
        return str(self.goal_id.id)

    @property
    def done(self) -> bool:
        """Whether it has ended; `status`, `text` and `result` are final then."""
        return self._ended.is_set()

    def cancel(self) -> None:
        """Asks the server to stop it; the answer comes as its end. Repeated until the server reacts."""
        if not self.done:
            self._client._send_cancel(self)

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits for its end.

        :param timeout: s of running time; None: as long as the server lives.
        :return: whether it has ended.
        """
        return Deadline(timeout).wait_event(self._ended)

    def _finish(self, status: int, text: str, result: Any) -> None:
        """Called once, without the client's lock."""
        self.status, self.text, self.result = status, text, result
        self._ended.set()
        if self._on_done is not None:
            self._on_done(self)


class ActionClient:
    """Sends goals to one action server.

    :param name: of the action; relative names and remapping as usual.
    :param action_spec: the generated ``...Action`` class.
    :param silence: s of running time without status after which a server that is no longer connected counts
        as dead, or in which one that publishes its status has to acknowledge a goal.
    """

    def __init__(self, name: str, action_spec: type, silence: float = SILENCE) -> None:
        self.name = rospy.resolve_name(name)
        self.silence = silence
        action = action_spec()
        self._goal_type = type(action.action_goal)
        self._result_type = type(action.action_result.result)
        self._changed = threading.Condition()  # guards the fields below
        self._goals: Dict[str, ClientGoal] = {}
        self._last_status: Optional[float] = None
        self._stopped = False
        self._watchdog: Optional[threading.Thread] = None
        listener = _Connected(self._changed)
        self._goal_publisher = rospy.Publisher(
            self.name + "/goal", self._goal_type, subscriber_listener=listener, queue_size=10
        )
        self._cancel_publisher = rospy.Publisher(
            self.name + "/cancel", GoalID, subscriber_listener=listener, queue_size=10
        )
        self._subscribers = [
            rospy.Subscriber(
                self.name + "/result", type(action.action_result), self._receive_result, tcp_nodelay=True
            ),
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
        """Whether a server is connected and not silent."""
        last = self._last_status
        return last is not None and self._connected() and running_time() - last < CONNECTED_SILENCE

    def wait_for_server(
        self, timeout: Optional[float] = None, unless: Callable[[], bool] = lambda: False
    ) -> bool:
        """Waits until a server is connected both ways.

        :param timeout: s of running time; None: until ROS shuts down.
        :param unless: ends the wait when it is true.
        """
        deadline = Deadline(timeout)
        with self._changed:
            while not self.alive:
                left = deadline.remaining()
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
    ) -> ClientGoal:
        """Sends a goal.

        :param on_done: called once with the ended goal, in a thread of this client; must not block.
        :param on_feedback: called with the goal and each feedback, likewise.
        """
        now = rospy.Time.now()
        goal_id = GoalID(stamp=now, id=f"{rospy.get_name()}-{next(_numbers)}-{now.secs}.{now.nsecs:09d}")
        sent = ClientGoal(self, goal_id, on_done, on_feedback)
        message = self._goal_type(goal_id=goal_id, goal=goal)
        message.header.stamp = now
        with self._changed:
            self._goals[sent.id] = sent
            if self._watchdog is None:
                self._watchdog = threading.Thread(
                    target=self._watch, name=f"client of {self.name}", daemon=True
                )
                self._watchdog.start()
            self._changed.notify_all()
        self._goal_publisher.publish(message)
        return sent

    def shutdown(self) -> None:
        """Disconnects; goals that still run end as LOST here and go on at the server."""
        with self._changed:
            self._stopped = True
            goals = list(self._goals.values())
            self._goals.clear()
            self._changed.notify_all()
        for topic in [*self._subscribers, self._goal_publisher, self._cancel_publisher]:
            topic.unregister()
        for goal in goals:
            goal._finish(GoalStatus.LOST, "the client was shut down", self._result_type())

    def _connected(self) -> bool:
        return bool(
            self._goal_publisher.get_num_connections()
            and self._cancel_publisher.get_num_connections()
            and all(subscriber.get_num_connections() for subscriber in self._subscribers)
        )

    def _send_cancel(self, goal: ClientGoal) -> None:
        with self._changed:
            goal.cancel_sent = running_time()
            self._changed.notify_all()
        # Never with a stamp: a server would also cancel every goal sent in the same tick of the clock.
        self._cancel_publisher.publish(GoalID(id=goal.id))

    def _receive_result(self, message: Any) -> None:
        status = message.status
        with self._changed:
            goal = self._goals.pop(status.goal_id.id, None)
        if goal is not None:
            goal._finish(status.status, status.text, message.result)

    def _receive_feedback(self, message: Any) -> None:
        with self._changed:
            goal = self._goals.get(message.status.goal_id.id)
        if goal is not None:
            goal.feedback = message.feedback
            if goal._on_feedback is not None:
                goal._on_feedback(goal, message.feedback)

    def _receive_status(self, message: GoalStatusArray) -> None:
        statuses = {status.goal_id.id: status for status in message.status_list}
        lost: List[ClientGoal] = []
        with self._changed:
            now = running_time()
            self._last_status = now
            for goal in list(self._goals.values()):
                status = statuses.get(goal.id)
                if status is not None:
                    goal.seen = True
                    goal.status = status.status if status.status not in TERMINAL else goal.status
                    if status.status in TERMINAL and goal.ended_on_server is None:
                        goal.ended_on_server = now
                        goal.text = status.text
                elif goal.seen and goal.ended_on_server is None:
                    lost.append(self._goals.pop(goal.id))
            self._changed.notify_all()
        for goal in lost:
            goal._finish(
                GoalStatus.LOST,
                f"the action server {self.name} forgot the goal; it restarted",
                self._result_type(),
            )

    def _watch(self) -> None:
        """Ends goals whose server is silent and repeats cancels that got lost."""
        while True:
            with self._changed:
                while not self._goals and not self._stopped:
                    self._changed.wait()
                if self._stopped or rospy.is_shutdown():
                    return
                self._changed.wait(REPEAT_CANCEL / 2)
                now = running_time()
                ended = [
                    (goal, why) for goal in self._goals.values() for why in [self._why_lost(goal, now)] if why
                ]
                for goal, _ in ended:
                    del self._goals[goal.id]
                again = [
                    goal
                    for goal in self._goals.values()
                    if goal.cancel_sent is not None
                    and now - goal.cancel_sent > REPEAT_CANCEL
                    and goal.status not in (GoalStatus.PREEMPTING, GoalStatus.RECALLING)
                ]
            for goal, why in ended:
                goal._finish(GoalStatus.LOST, why, self._result_type())
            for goal in again:
                self._send_cancel(goal)

    def _why_lost(self, goal: ClientGoal, now: float) -> str:
        last = self._last_status or 0.0
        silent = now - max(last, goal.sent)
        if silent > (CONNECTED_SILENCE if self._connected() else self.silence):
            return f"the action server {self.name} has been silent for {silent:.1f} s"
        if not goal.seen and last - goal.sent > self.silence:
            return f"the action server {self.name} never acknowledged the goal"
        if goal.ended_on_server is not None and now - goal.ended_on_server > LATE_RESULT:
            return f"the action server {self.name} ended the goal without a result: {goal.text}"
        return ""


class _Connected(rospy.SubscribeListener):
    """Wakes who waits for a server when one connects."""

    def __init__(self, changed: threading.Condition) -> None:
        super().__init__()
        self._changed = changed

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Any) -> None:
        with self._changed:
            self._changed.notify_all()
