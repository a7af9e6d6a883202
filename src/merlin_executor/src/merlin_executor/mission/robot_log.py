"""What the robot does, says, hears and sees, one line each, for a mission's screen. It changes nothing."""

import threading
from typing import Callable, Dict, List, NamedTuple, Sequence, Set, Tuple

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import ExecutorStatus, ListenActionResult, RecognizeActionResult
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from sound_play.msg import SoundRequestActionGoal

from merlin_sm.knowledge_text import action_text
from merlin_sm.states.recognition import recognized

DISPATCHER = "rosplan_plan_dispatcher"


class Deed(NamedTuple):
    """One action that the robot carried out, s of ROS time.

    Attributes:
        text: as PDDL.
        reason: why it failed; empty: it succeeded.
    """

    text: str
    begun: float
    ended: float
    reason: str


class RobotLog:
    """Listens to the planning system and to the robot's speech.

    :param log: takes a line of what happens.
    :param on_failure: called with an action as PDDL and the reason.
    """

    def __init__(
        self,
        log: Callable[[str], None],
        on_failure: Callable[[str, str], None] = lambda action, reason: None,
    ) -> None:
        self._log = log
        self._on_failure = on_failure
        self._lock = threading.Lock()  # guards the fields below
        self._running: Dict[Tuple[int, int], Tuple[str, float]] = {}
        self.deeds: List[Deed] = []
        self._request = ""  # these three are the subscriber's of merlin/status alone
        self._goal = ""
        self._known_requests: Set[str] = set()
        for topic, kind, receive in (
            ("merlin/status", ExecutorStatus, self._pursued),
            (f"{DISPATCHER}/action_dispatch", ActionDispatch, self._dispatched),
            (f"{DISPATCHER}/action_feedback", ActionFeedback, self._answered),
            ("sound_play/goal", SoundRequestActionGoal, self._spoke),
            ("listen/result", ListenActionResult, self._heard),
            ("recognize/result", RecognizeActionResult, self._saw),
        ):
            rospy.Subscriber(topic, kind, receive, queue_size=100, tcp_nodelay=True)

    def _pursued(self, status: ExecutorStatus) -> None:
        """Logs which goal the robot pursues now, and how the last one ended."""
        if status.request == self._request:
            return
        if self._request:
            self._log(f"goal {self._goal}: {status.reason.partition(': ')[2] or 'left'}")
        self._request = status.request
        if status.request:
            self._goal = goal_text(status.goals, status.priority)
            again = "goes on with" if status.request in self._known_requests else "goal"
            self._known_requests.add(status.request)
            self._log(f"{again} {self._goal}")

    def _dispatched(self, action: ActionDispatch) -> None:
        if action.name.lower() == "cancel_action":
            return
        text = action_text(action.name, action.parameters)
        with self._lock:
            self._running[action.plan_id, action.action_id] = (text, rospy.get_time())
        self._log(text)

    def _answered(self, feedback: ActionFeedback) -> None:
        done = feedback.status == ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE
        if not done and feedback.status != ActionFeedback.ACTION_FAILED:
            return
        with self._lock:
            text, begun = self._running.pop((feedback.plan_id, feedback.action_id), ("", 0.0))
            reason = "" if done else _reason(feedback.information)
            if text:
                self.deeds.append(Deed(text, begun, rospy.get_time(), reason))
        if text and not done:
            self._log(f"{text}: {reason}")
            if reason != "cancelled":
                self._on_failure(text, reason)

    def _spoke(self, goal: SoundRequestActionGoal) -> None:
        self._log(f'says "{goal.goal.sound_request.arg}"')

    def _heard(self, result: ListenActionResult) -> None:
        if result.result.text:
            self._log(f'understands "{result.result.text}"')
        elif result.result.heard:
            self._log("hears something it does not understand")

    def _saw(self, result: RecognizeActionResult) -> None:
        seen = [
            f"{item.name} ({item.position[0]:.1f}, {item.position[1]:.1f})"
            for item in recognized(result.result)
        ]
        self._log(f"sees {', '.join(seen) or 'nothing'}")


class Screen:
    """Prints lines with the time since the first one, one line at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the begin, and keeps lines apart
        self._begin = -1.0

    def line(self, speaker: str, text: str) -> None:
        """Prints a line."""
        with self._lock:
            now = rospy.get_time()
            self._begin = now if self._begin < 0.0 else self._begin
            print(f"{now - self._begin:7.1f} s  {speaker:<7} {text}", flush=True)


def goal_text(goals: Sequence[str], priority: int) -> str:
    """Goals in a few words."""
    more = f" and {len(goals) - 1} more" if len(goals) > 1 else ""
    return f"{goals[0] if goals else ''}{more}{', urgent' if priority else ''}"


def _reason(information: Sequence[KeyValue]) -> str:
    return next((entry.value for entry in information if entry.key == "reason"), "failed")
