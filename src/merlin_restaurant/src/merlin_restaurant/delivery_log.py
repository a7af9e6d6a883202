# SPDX-License-Identifier: Apache-2.0
"""What the robot does, believes and says, for log, timeline and record. It changes nothing."""

import threading
from typing import Callable, List, Sequence, Set

import rospy
from merlin_msgs.msg import KnowledgeChanges, ListenActionResult
from nav_msgs.msg import Odometry
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.mission.robot_log import RobotLog
from merlin_planning.knowledge_text import to_pddl
from merlin_restaurant.robots_account import Mileage


class DeliveryLog(RobotLog):
    """Listens to the planning system and to the robots' speech, and counts their metres.

    :param log: takes a line of what happens.
    :param on_delivery: called with a table and its items when the robot has delivered them.
    :param on_failure: called with an action as PDDL and the reason.
    :param robots: the namespaces of several robots; empty: one robot without a namespace.
    """

    def __init__(
        self,
        log: Callable[[str], None],
        on_delivery: Callable[[str, List[str]], None],
        on_failure: Callable[[str, str], None],
        robots: Sequence[str] = ("",),
    ) -> None:
        self._log = log
        self._on_delivery = on_delivery
        self._lock = threading.Lock()  # guards the facts
        self._facts: Set[str] = set()
        self.mileage = Mileage()
        super().__init__(log, on_failure, robots)
        for robot in robots:
            name = f"{robot}/odom" if robot else "odom"
            rospy.Subscriber(name, Odometry, self.mileage.move, robot, queue_size=5, tcp_nodelay=True)
        for topic, kind, receive in (
            ("rosplan_knowledge_base/changes", KnowledgeChanges, self._learned),
            ("calls/listen/result", ListenActionResult, self._heard_call),
        ):
            rospy.Subscriber(topic, kind, receive, queue_size=100, tcp_nodelay=True)

    def _learned(self, changes: KnowledgeChanges) -> None:
        added, removed = _facts(changes.added), _facts(changes.removed)
        delivered = []
        with self._lock:
            for fact in added:
                table = fact.strip("()").split()[-1]
                if fact.startswith("(already_served") and any(
                    gone.startswith("(carrying") and gone.endswith(f" {table})") for gone in removed
                ):
                    wanted = [item.strip("()").split() for item in self._facts if item.startswith("(wants")]
                    delivered.append((table, [words[2] for words in wanted if words[1] == table]))
            self._facts.difference_update(removed)
            self._facts.update(added)
        for table, items in delivered:
            self._on_delivery(table, items)
        news = [fact for fact in added if fact.split()[0].strip("()") in TOLD]
        if news:
            self._log(f"knows {' '.join(news)}")

    def _heard_call(self, result: ListenActionResult) -> None:
        # This ear hears every answer that is meant for the other one, too.
        if result.result.text:
            self._heard(result, "")


#: Predicates whose new facts are worth a line.
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


def _facts(items: List[KnowledgeItem]) -> List[str]:
    return [to_pddl(item) for item in items if item.knowledge_type == KnowledgeItem.FACT]
