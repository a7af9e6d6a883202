"""What the robot does, believes and says, for log, timeline and record. It changes nothing."""

import threading
from typing import Callable, Dict, List, NamedTuple, Set, Tuple

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import ExecutorStatus, KnowledgeChanges, ListenActionResult, RecognizeActionResult
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import KnowledgeItem
from sound_play.msg import SoundRequestActionGoal

from merlin_sm.knowledge_text import action_text, to_pddl
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


class RobotWatch:
    """Listens to the planning system and to the robot's speech.

    :param log: takes a line of what happens.
    :param on_delivery: called with a table and its items when the robot has delivered them.
    :param on_failure: called with an action as PDDL and the reason.
    """

    def __init__(
        self,
        log: Callable[[str], None],
        on_delivery: Callable[[str, List[str]], None],
        on_failure: Callable[[str, str], None],
    ) -> None:
        self._log = log
        self._on_delivery = on_delivery
        self._on_failure = on_failure
        self._lock = threading.Lock()  # guards the fields below
        self._running: Dict[Tuple[int, int], Tuple[str, float]] = {}
        self._facts: Set[str] = set()
        self.deeds: List[Deed] = []
        self._request = ""  # these three are the subscriber's of merlin/status alone
        self._goal = ""
        self._known_requests: Set[str] = set()
        for topic, kind, receive in (
            ("merlin/status", ExecutorStatus, self._pursued),
            (f"{DISPATCHER}/action_dispatch", ActionDispatch, self._dispatched),
            (f"{DISPATCHER}/action_feedback", ActionFeedback, self._answered),
            ("rosplan_knowledge_base/changes", KnowledgeChanges, self._learned),
            ("sound_play/goal", SoundRequestActionGoal, self._spoke),
            ("listen/result", ListenActionResult, self._heard),
            ("calls/listen/result", ListenActionResult, self._heard_call),
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
            self._goal = _goal(status.goals, status.priority)
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

    def _learned(self, changes: KnowledgeChanges) -> None:
        added, removed = _facts(changes.added), _facts(changes.removed)
        delivered = []
        with self._lock:
            for fact in added:
                if fact.startswith("(already_served") and any(
                    fact.replace("already_served", "carrying") == gone for gone in removed
                ):
                    table = fact.strip("()").split()[1]
                    wanted = [item.strip("()").split() for item in self._facts if item.startswith("(wants")]
                    delivered.append((table, [words[2] for words in wanted if words[1] == table]))
            self._facts.difference_update(removed)
            self._facts.update(added)
        for table, items in delivered:
            self._on_delivery(table, items)
        news = [fact for fact in added if fact.split()[0].strip("()") in TOLD]
        if news:
            self._log(f"knows {' '.join(news)}")

    def _spoke(self, goal: SoundRequestActionGoal) -> None:
        self._log(f'says "{goal.goal.sound_request.arg}"')

    def _heard(self, result: ListenActionResult) -> None:
        if result.result.text:
            self._log(f'understands "{result.result.text}"')
        elif result.result.heard:
            self._log("hears something it does not understand")

    def _heard_call(self, result: ListenActionResult) -> None:
        # This ear hears every answer that is meant for the other one, too.
        if result.result.text:
            self._heard(result)

    def _saw(self, result: RecognizeActionResult) -> None:
        seen = [
            f"{item.name} ({item.position[0]:.1f}, {item.position[1]:.1f})"
            for item in recognized(result.result)
        ]
        self._log(f"sees {', '.join(seen) or 'nothing'}")


TOLD = (
    "needs_serving",
    "already_served",
    "needs_cleaning",
    "ready",
    "wants",
    "waiting",
    "carrying",
    "seated",
)
"""Predicates whose new facts are worth a line."""


def _goal(goals: List[str], priority: int) -> str:
    more = f" and {len(goals) - 1} more" if len(goals) > 1 else ""
    return f"{goals[0] if goals else ''}{more}{', urgent' if priority else ''}"


def _facts(items: List[KnowledgeItem]) -> List[str]:
    return [to_pddl(item) for item in items if item.knowledge_type == KnowledgeItem.FACT]


def _reason(information: List[KeyValue]) -> str:
    return next((entry.value for entry in information if entry.key == "reason"), "failed")
