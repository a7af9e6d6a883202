# SPDX-License-Identifier: Apache-2.0
"""A request that was sent to the Executor; it is sent again where its client asks so."""

import threading
from typing import Callable, Optional

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from merlin_msgs.msg import ExecuteFeedback, ExecuteGoal, ExecuteResult

from merlin_executor.core.agenda import client_was_lost
from merlin_executor.resending import END, RESEND, Resending, was_begun, was_lost
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.client_goal import TERMINAL, ClientGoal
from merlin_ros.deadline import Deadline, running_time
from merlin_ros.late_topics import subscribe_by
from merlin_ros.work.threads import start_thread

GOES_ON = "it goes on without its client"


class ExecutorRequest:
    """A request that was sent.

    :param client: of ``merlin/execute``.
    :param goal: is sent at once.
    :param on_done: called with this request when it has ended, in another thread.
    :param on_feedback: called with each feedback, in another thread.
    :param on_lost: what happens when the Executor is lost: END or RESEND (:mod:`merlin_executor.resending`).
        One that survives is always found again.
    :param known: its id, where it was sent before and survives.
    """

    def __init__(
        self,
        client: ActionClient,
        goal: ExecuteGoal,
        on_done: Optional[Callable[["ExecutorRequest"], None]] = None,
        on_feedback: Optional[Callable[[ExecuteFeedback], None]] = None,
        on_lost: str = END,
        known: str = "",
    ) -> None:
        self._client = client
        self._goal = goal
        self._on_done = on_done
        self._on_feedback = on_feedback
        self._known = known
        self._resending = Resending(
            RESEND if goal.survives else on_lost, running_time, survives=bool(goal.survives)
        )
        self._ended = threading.Event()
        self.begun = False
        """Whether it had begun when it ended, or was lost before it was sent again."""
        self._reason = ""
        self._wake = threading.Event()  # ends the wait for the Executor: it is back, or the client cancels
        self._lock = threading.Lock()  # guards _resending, _sent, begun and _wake
        with self._lock:
            self._sent = self._send()

    @property
    def id(self) -> str:
        """The actionlib goal id; ``merlin/status`` and ``merlin/queue`` name the request by it.

        A request that is sent again gets another one, unless it survives.
        """
        return self._sent.id

    @property
    def survives(self) -> bool:
        """Whether it goes on without this client."""
        return bool(self._goal.survives)

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._ended.is_set()

    @property
    def taken_back(self) -> bool:
        """Whether another node has cancelled it, as an operator does; not its own client, nor its silence."""
        result = self.result
        if result is None or result.outcome != ExecuteResult.CANCELLED:
            return False
        return not (self._resending.cancelled or client_was_lost(result.reason))

    @property
    def ended_at(self) -> float:
        """When it has ended, s of the Executor's ROS time; NaN: that has not said so."""
        return self._sent.ended_at

    @property
    def state(self) -> int:
        """A constant of actionlib_msgs/GoalStatus."""
        return self._sent.status

    @property
    def feedback(self) -> Optional[ExecuteFeedback]:
        """The last feedback."""
        return self._sent.feedback

    @property
    def result(self) -> Optional[ExecuteResult]:
        """How it ended; None while it runs. An Executor that disappeared gives INTERNAL and the reason."""
        if not self.done:
            return None
        sent = self._sent
        result: ExecuteResult = sent.result
        reason = getattr(result, "reason", "")
        verdict = self._resending.verdict(sent.status, sent.text, reason, self._reason)
        if verdict is None:
            return result
        return ExecuteResult(outcome=int(verdict.outcome), reason=verdict.reason)

    def cancel(self) -> None:
        """Stops it, wherever it is: queued, planning or under way. The answer is its end.

        While the Executor is gone, that of one that survives comes from the next one.
        """
        with self._lock:
            self._resending.cancel()
            sent = self._sent
            if self._resending.given_up:
                self._wake.set()
        sent.cancel()

    def leave(self) -> None:
        """Its client waits no longer: it is cancelled. One that survives ends here only, and goes on."""
        if not self.survives:
            self.cancel()
            return
        with self._lock:
            self._resending.leave()
            self._wake.set()
        self._finish(GOES_ON)

    def wait(self, timeout: Optional[float] = None) -> bool:
        """Waits for its end.

        :param timeout: s, which stand still while the simulator is paused; None: as long as it takes.
        :return: whether it has ended.
        """
        return Deadline(timeout).wait_event(self._ended)

    def _send(self) -> ClientGoal:
        """Called with the lock held: a goal may end before this returns."""
        feedback = self._on_feedback
        forward = (lambda _, message: feedback(message)) if feedback is not None else None
        if not self.survives:
            return self._client.send(self._goal, self._sent_ended, forward)
        sent = self._client.send(self._goal, self._sent_ended, forward, lasting=True, again=self._known)
        self._known = sent.id
        return sent

    def _sent_ended(self, sent: ClientGoal) -> None:
        with self._lock:
            reason = getattr(sent.result, "reason", "")
            lost = was_lost(sent.status, sent.text, reason)
            self.begun = self.begun or was_begun(sent.active, sent.status, lost)
            ends = self._resending.ended(lost, untaken=self._client.heard and not sent.seen)
        if ends is not None:
            self._finish(ends)
            return
        try:
            start_thread(f"resend {sent.id}", self._await)
        except RuntimeError as error:
            self._finish(f"the executor is lost, and this node cannot wait for it: {error}")

    def _await(self) -> None:
        """Waits for the Executor's return and sends the goal again."""
        rospy.logwarn(f"a goal is lost; it is sent again when the executor is there ({self._why})")
        with self._lock:
            if not self._resending.given_up:
                self._wake = threading.Event()  # that of an earlier loss is set
        is_there = self._returned()
        with self._lock:
            ends = self._resending.executor(is_there)
            cancels = self._resending.cancelled
            if ends is None:
                self._sent = self._send()
        if ends is not None:
            goes_down = rospy.is_shutdown() and not is_there
            self._finish("the executor is gone, and this node shuts down" if goes_down else ends)
        elif cancels:
            self._sent.cancel()

    def _returned(self) -> bool:
        """Whether the Executor publishes its status, and is connected; False also after a cancel."""
        deadline = Deadline(self._resending.patience)
        wake, sent = self._wake, self._sent
        goes_down = sent.status != GoalStatus.LOST and not client_was_lost(self._why)

        def hear(status: GoalStatusArray) -> None:
            # An Executor that goes down names for a while yet the goal that it has ended. It would refuse
            # the next one.
            ended = [entry.goal_id.id for entry in status.status_list if entry.status in TERMINAL]
            if not goes_down or sent.id not in ended:
                wake.set()

        # A subscriber of its own: what the client has heard before may be of the Executor that was lost.
        topic = f"{self._client.name}/status"
        subscriber = subscribe_by(deadline, wake, topic, GoalStatusArray, hear)
        heard = deadline.wait_event(wake)
        if subscriber is not None:
            subscriber.unregister()
        left = deadline.remaining()
        return heard and self._client.wait_for_server(left, lambda: self._resending.given_up)

    @property
    def _why(self) -> str:
        """Why what was sent has ended."""
        return getattr(self._sent.result, "reason", "") or self._sent.text

    def _finish(self, reason: str) -> None:
        with self._lock:
            if self.done:
                return
            self._reason = reason
            self._ended.set()
        if self._on_done is not None:
            self._on_done(self)
