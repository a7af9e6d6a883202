# SPDX-License-Identifier: Apache-2.0
"""The evening in the restaurant as a node: the mission with its live log, its record and its timeline.

Exit code: 0 when the books balance, 1 when they do not, 2 when the evening could not begin or continue or its
results not be written, 130 when it was interrupted.
"""

import threading
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Set

import rospy
from merlin_msgs.msg import GuestEvent, KnowledgeChanges, ListenActionResult
from nav_msgs.msg import Odometry
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_executor.mission import RESEND, MissionError, results_folder
from merlin_executor.mission.robot_log import RobotLog
from merlin_planning.knowledge_text import to_pddl
from merlin_restaurant.evening import Evening
from merlin_restaurant.evening_record import COLUMNS as GUEST_COLUMNS
from merlin_restaurant.evening_record import EveningRecord
from merlin_restaurant.robots_account import COLUMNS as ROBOT_COLUMNS
from merlin_restaurant.robots_account import Mileage, robot_rows, robot_table, write_rows
from merlin_restaurant.table_state import STATES
from merlin_sm.states.merlin_state import SUCCEEDED

#: Predicates of which no fact may be left at the end, and the place where that is done.
UNDER_WAY = {"carrying": "bar", "prepared": "bar", "waiting": "entrance"}

BALANCED = (
    "the books balance: every guest was served or there is a reason, what was delivered was ordered,\n"
    "and the robot knows the world as it is"
)


class RecordedEvening(Evening):
    """Runs the mission and keeps its record.

    :param results: folder.
    :param on_lost: END or RESEND, what happens to goals during which the Executor is lost.
    :param robots: names of several robots, which share the evening by one plan; none: there is one.
    :raises ParameterError: when the folder cannot be made.
    :raises ValueError: for another `on_lost`.
    """

    servers: Sequence[str] = ("move_base", "sound_play", "listen", "recognize", "calls/listen")
    startup_timeout = 240.0  # on a busy machine the 30 nodes of two robots need more than 90 s
    tells = False  # it prints that itself, with the guests

    def __init__(
        self, results: Path = Path("results/restaurant"), on_lost: str = RESEND, robots: Sequence[str] = ()
    ) -> None:
        self._start: Optional[float] = None
        self._outcome = ""
        self._print = threading.Lock()  # one line at a time
        self._record_lock = threading.Lock()  # guards the record
        self._record = EveningRecord()
        super().__init__(self._closed, lambda text: self._line("mission", text), on_lost, "Evening", robots)
        self._names = list(robots) or [""]
        self._results = results_folder(results)
        self._watch = DeliveryLog(
            lambda text: self._line("robot", text), self._delivered, self._failed, self._names
        )
        rospy.Subscriber("restaurant/guests", GuestEvent, self._guest, queue_size=100)

    def carry_out(self) -> bool:
        """Runs the evening; True when its machine has succeeded."""
        self._start = rospy.get_time()
        self._outcome = self.run()
        return self._outcome == SUCCEEDED

    def finish(self, succeeded: bool) -> bool:
        """Closes the record, prints and writes it; True when the books balance.

        :raises MissionError: when the results cannot be written.
        :raises ServiceError: when the knowledge base is gone.
        """
        states = {
            table: next((state for state in STATES if self.holds(f"({state} {table})")), "")
            for table in self.objects("table")
        }
        kept = self._kept()
        blocked = self._blocked(kept)
        unreachable = [predicate for predicate, place in UNDER_WAY.items() if place in blocked]
        held = [
            fact
            for predicate in UNDER_WAY
            for fact in self.facts(predicate)
            if not self.out_of_reach(fact) and predicate not in unreachable and not _stands_at(fact, kept)
        ]
        problems = [] if succeeded else [f"the mission ended with {self._outcome}: {self.reason}"]
        with self._record_lock:
            self._record.close(states, held, blocked)
        return self._written(problems)

    def _written(self, problems: List[str]) -> bool:
        # matplotlib takes a second to import, which the start of the evening is spared.
        from merlin_restaurant.evening_results import guest_table, plot_timeline

        with self._record_lock:
            problems += self._record.problems()
            print("\n" + "\n".join(guest_table(self._record)) + "\n")
        robots = robot_rows(self._watch.deeds, self._names, self._watch.mileage)
        print("\n".join(robot_table(robots)) + "\n")
        for problem in problems:
            print(f"NOT BALANCED: {problem}")
        if not problems:
            print(BALANCED)
        table, timeline = self._results / "guests.csv", self._results / "timeline.png"
        shares = self._results / "robots.csv"
        try:
            with self._record_lock:
                write_rows(table, GUEST_COLUMNS, self._record.rows())
                plot_timeline(timeline, self._watch.deeds, self._record, self._begun, self._names)
            write_rows(shares, ROBOT_COLUMNS, robots)
        except OSError as error:
            raise MissionError(f"the results cannot be written: {error}") from error
        print(f"written: {table}\nwritten: {shares}\nwritten: {timeline}", flush=True)
        return not problems

    @property
    def _begun(self) -> float:
        """When the mission began, s of ROS time; before that: now."""
        return rospy.get_time() if self._start is None else self._start

    def _closed(self) -> bool:
        with self._record_lock:
            return self._record.closed is not None

    def _guest(self, event: GuestEvent) -> None:
        time = event.header.stamp.to_sec() - self._begun
        with self._record_lock:
            self._record.guest_event(time, event.event, event.guest, event.table, event.items, event.reason)
        self._line(event.guest or "house", _event_text(event))

    def _delivered(self, table: str, items: List[str]) -> None:
        with self._record_lock:
            self._record.delivered(rospy.get_time() - self._begun, table, items)

    def _failed(self, action: str, reason: str) -> None:
        with self._record_lock:
            self._record.robot_failed(action.strip("()").split()[-1], f"{action}: {reason}")

    def _line(self, speaker: str, text: str) -> None:
        time = rospy.get_time() - self._begun
        with self._print:
            print(f"{time:7.1f} s  {speaker:<7} {text}", flush=True)


def _stands_at(fact: str, kept: Sequence[str]) -> bool:
    """Whether an order stands on a counter to which no robot can come."""
    predicate, *places = fact.strip("()").split()
    return predicate == "prepared" and places[0] in kept


def _event_text(event: GuestEvent) -> str:
    items, table = " and ".join(event.items), event.table.replace("_", " ")
    return {
        GuestEvent.CAME: f"comes to {table or 'the entrance'}",
        GuestEvent.SEATED: f"sits down at {table}",
        GuestEvent.CALLED: "calls for the robot",
        GuestEvent.ORDERED: f"has ordered {items}",
        GuestEvent.SERVED: f"gets {items}",
        GuestEvent.LEFT: f"leaves: {event.reason}",
        GuestEvent.CLEARED: f"{table} is cleared",
        GuestEvent.DISTURBED: f"DISTURBANCE: {event.reason}",
        GuestEvent.CLOSED: "the restaurant closes",
    }[event.event]


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
