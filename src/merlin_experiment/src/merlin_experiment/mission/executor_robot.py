# SPDX-License-Identifier: Apache-2.0
"""The robot of a mission as ROS shows it: the Executor, the knowledge base, the clock."""

import threading
from typing import Callable, Dict, List, Optional, Tuple

import rospy
from merlin_msgs.msg import ExecutorStatus

from merlin_executor.executor_client import ExecutorRequest, MerlinExecutorClient, outcome_name
from merlin_executor.resending import END
from merlin_experiment.mission.measured_mission import MissionStopped, RequestEnding
from merlin_experiment.records.trajectory import Trajectory
from merlin_ros.deadline import Deadline
from merlin_ros.ros_alarm import call_after
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

#: Running time within which the Executor is idle after it has answered, s.
IDLE_TIMEOUT = 30.0


class SentRequest:
    """A request to the Executor."""

    def __init__(self, sent: ExecutorRequest) -> None:
        self._sent = sent

    def cancel(self) -> None:
        """Asks for its end; returns at once."""
        self._sent.cancel()

    def wait(self) -> RequestEnding:
        """Waits until it has ended.

        :raises MissionStopped: this node ends.
        """
        self._sent.wait()
        result = self._sent.result
        if result is None:
            raise MissionStopped("interrupted")
        return RequestEnding(outcome_name(result.outcome), result.stage, result.reason, result.replans)


class ExecutorRobot(MerlinROSPlanAssistant):
    """What a mission needs, over the Executor.

    :ivar trajectory: where the robot was.
    :ivar doing: what it does now, for people.
    :ivar client: of the Executor.
    """

    def __init__(self, trajectory: Trajectory, on_action: Callable[[str], None], on_lost: str = END) -> None:
        """:param trajectory: filled by the subscriber of the ground truth.
        :param on_action: called with its operator when an action was dispatched.
        :param on_lost: END or RESEND, what happens to a task during which the Executor is lost.
        """
        self.trajectory = trajectory
        self.doing = ""
        self._on_action = on_action
        self._changed = threading.Condition()  # guards the fields below
        self._status: Optional[ExecutorStatus] = None
        self._running: Dict[Tuple[int, int], Tuple[str, float]] = {}
        self._actions: List[Tuple[str, float, float]] = []
        self._disturbed: List[Tuple[float, float]] = []
        self._disturbed_since: Optional[float] = None
        self._own = f"{rospy.get_name()}-"  # how the ids of its requests begin
        self.client = MerlinExecutorClient(on_lost=on_lost)
        self._subscriber = rospy.Subscriber(
            "merlin/status", ExecutorStatus, self._receive, queue_size=20, tcp_nodelay=True
        )

    def now(self) -> float:
        """ROS time, s."""
        return rospy.get_time()

    def forget(self, poi: str) -> None:
        """Makes a point of interest unchecked."""
        self.remove_facts(f"(checked {poi})")

    def send(self, poi: str) -> SentRequest:
        """Sends the goal that a point of interest is checked; never in a plan with others."""
        return SentRequest(self.client.send(f"(checked {poi})", alone=True))

    def call_after(self, seconds: float, action: Callable[[], None]) -> Callable[[], None]:
        """Calls a function after some ROS time, in a thread of its own; returns what prevents that."""
        return call_after(seconds, action, "measured mission").shutdown

    def wait_idle(self) -> None:
        """Waits until the Executor says that it is idle, or works for another client.

        :raises MissionStopped: it does not within IDLE_TIMEOUT.
        """
        with self._changed:
            if not Deadline(IDLE_TIMEOUT).wait(self._changed, self._idle):
                raise MissionStopped(f"the Executor is not idle {IDLE_TIMEOUT:.0f} s after its answer")

    def wait_free(self, stopped: Callable[[], bool], tell: Callable[[str], None]) -> None:
        """Waits as long as the Executor works for another client, or waits for a base to be released.

        :param stopped: ends the wait; call :meth:`wake` when it becomes true.
        :param tell: called with what it waits for, unless it does not wait.
        """
        with self._changed:
            why = self._disturbance()
            if why:
                tell(f"waits: {why}")
            Deadline(None).wait(self._changed, lambda: stopped() or not self._disturbance())

    def wake(self) -> None:
        """Wakes :meth:`wait_free`."""
        with self._changed:
            self._changed.notify_all()

    def disturbed(self, since: float, until: float) -> float:
        """s between two times in which the Executor worked for others, or waited for a release."""
        with self._changed:
            open_ended = [] if self._disturbed_since is None else [(self._disturbed_since, until)]
            spans = [*self._disturbed, *open_ended]
        return sum(max(0.0, min(end, until) - max(begin, since)) for begin, end in spans)

    def action_times(self, since: float) -> List[Tuple[str, float, float]]:
        """The actions that began since a time: operator, start, end (s of ROS time); forgets earlier ones."""
        with self._changed:
            self._actions = [entry for entry in self._actions if entry[1] >= since]
            return list(self._actions)

    def _idle(self) -> bool:
        status = self._status
        return status is not None and not (status.state and status.request.startswith(self._own))

    def _disturbance(self) -> str:
        """What keeps the Executor from the mission's requests; empty: nothing."""
        status = self._status
        if status is None or status.waits or not status.request or status.request.startswith(self._own):
            return status.waits if status is not None else ""
        return f"{', '.join(status.goals)} of another client runs"

    def _receive(self, status: ExecutorStatus) -> None:
        now = status.header.stamp.to_sec()
        running = {
            (action.plan_id, action.action_id): (action.name.lower(), action.dispatched.to_sec())
            for action in status.running
        }
        with self._changed:
            for key in set(self._running) - set(running):
                operator, begun = self._running[key]
                self._actions.append((operator, begun, now))
            started = set(running) - set(self._running)
            self._running = running
            self._status = status
            if not self._disturbance() and self._disturbed_since is not None:
                self._disturbed.append((self._disturbed_since, now))
                self._disturbed_since = None
            elif self._disturbance() and self._disturbed_since is None:
                self._disturbed_since = now
            self.doing = _plain_words(status)
            self._changed.notify_all()
        for key in sorted(started):
            self._on_action(running[key][0])


def _plain_words(status: ExecutorStatus) -> str:
    """What the Executor does, for people."""
    if status.state == ExecutorStatus.CANCELLING:
        return "stopping"
    if status.running:
        action = status.running[0]
        return f"{action.name} {' '.join(entry.value for entry in action.parameters[-1:])}"
    return status.stage.lower().replace("_", " ") if status.stage else "idle"
