"""Node `mission`: the evening in the restaurant, with its live log, its books and its timeline.

Exit code: 0 when the books balance, 1 when they do not, 2 when the evening could not begin or go on or its
results not be written, 130 when it was interrupted.
"""

import sys
import threading
from pathlib import Path
from typing import List, Optional

import rospy
from merlin_msgs.msg import GuestEvent
from rospy.core import is_shutdown_requested

from merlin_executor.readiness import missing_interfaces, missing_servers
from merlin_executor.resending import ON_LOST, RESEND
from merlin_restaurant.evening import Evening
from merlin_restaurant.evening_record import EveningRecord
from merlin_restaurant.robot_watch import RobotWatch
from merlin_restaurant.table_state import STATES
from merlin_ros.node import init_node
from merlin_ros.parameters import ParameterError, number
from merlin_ros.service_proxy import ServiceError
from merlin_sm.states.merlin_state import SUCCEEDED

EXIT_UNBALANCED, EXIT_STOPPED, EXIT_INTERRUPTED = 1, 2, 130
SERVERS = ("move_base", "sound_play", "listen", "recognize", "calls/listen")
UNDER_WAY = ("carrying", "prepared", "waiting")
"""Predicates of which nothing may be left at the end."""


BALANCED = (
    "the books balance: every guest was served or there is a reason, what was delivered was ordered,\n"
    "and the robot knows the world as it is"
)


class EveningStopped(RuntimeError):
    """The evening could not begin or end; the text says why."""


class EveningNode:
    """Runs the mission and keeps its record.

    :param results: folder.
    :param startup: s of wall time for everything to appear.
    :param on_lost: END or RESEND, what happens to goals during which the Executor is lost.
    """

    def __init__(self, results: Path, startup: float, on_lost: str = RESEND) -> None:
        self._results = results
        self._startup = startup
        self._start: Optional[float] = None
        self._print = threading.Lock()  # one line at a time
        self._record_lock = threading.Lock()  # guards the record
        self._record = EveningRecord()
        self._watch = RobotWatch(lambda text: self._line("robot", text), self._delivered, self._failed)
        self._evening = Evening(self._closed, lambda text: self._line("mission", text), on_lost)
        rospy.Subscriber("restaurant/guests", GuestEvent, self._guest, queue_size=100)

    def run(self) -> int:
        """Runs the evening; returns the exit code.

        :raises EveningStopped: something is missing at the beginning, or the results cannot be written.
        :raises ServiceError: the knowledge base is gone.
        """
        self._wait_for_robot()
        self._start = rospy.get_time()
        outcome = self._evening.run()
        if is_shutdown_requested():
            return EXIT_INTERRUPTED
        robot = self._evening
        states = {
            table: next((state for state in STATES if robot.holds(f"({state} {table})")), "")
            for table in robot.objects("table")
        }
        held = [fact for predicate in UNDER_WAY for fact in robot.facts(predicate)]
        with self._record_lock:
            self._record.close(states, held)
        problems = [] if outcome == SUCCEEDED else [f"the mission ended with {outcome}: {robot.reason}"]
        return self._finish(problems)

    def _finish(self, problems: List[str]) -> int:
        # matplotlib takes a second to import, which the start of the evening is spared.
        from merlin_restaurant.evening_results import guest_table, plot_timeline, write_guests

        with self._record_lock:
            problems += self._record.problems()
            print("\n" + "\n".join(guest_table(self._record)) + "\n")
        for problem in problems:
            print(f"NOT BALANCED: {problem}")
        if not problems:
            print(BALANCED)
        table, timeline = self._results / "guests.csv", self._results / "timeline.png"
        try:
            with self._record_lock:
                write_guests(table, self._record)
                plot_timeline(timeline, self._watch.deeds, self._record, self._begun)
        except OSError as error:
            raise EveningStopped(f"the results cannot be written: {error}") from error
        print(f"written: {table}\nwritten: {timeline}", flush=True)
        return EXIT_UNBALANCED if problems else 0

    def _wait_for_robot(self) -> None:
        timeout = self._startup
        if not self._evening.knowledge.wait(timeout):
            raise EveningStopped(f"no knowledge base after {timeout:.0f} s")
        missing = missing_interfaces(self._evening.knowledge, timeout)
        if missing:
            raise EveningStopped(f"no action interface for {', '.join(missing)} after {timeout:.0f} s")
        missing = missing_servers(SERVERS, timeout)
        if missing:
            raise EveningStopped(
                f"no action server {', '.join(missing)} after {timeout:.0f} s; is it launched?"
            )

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
        self._line(event.guest or "house", _told(event))

    def _delivered(self, table: str, items: List[str]) -> None:
        with self._record_lock:
            self._record.delivered(rospy.get_time() - self._begun, table, items)

    def _failed(self, action: str, reason: str) -> None:
        with self._record_lock:
            self._record.robot_failed(action.strip("()").split()[-1], f"{action}: {reason}")

    def _line(self, who: str, text: str) -> None:
        time = rospy.get_time() - self._begun
        with self._print:
            print(f"{time:7.1f} s  {who:<7} {text}", flush=True)


def _told(event: GuestEvent) -> str:
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


def main() -> int:
    """Entry point of the node; returns the exit code."""
    init_node("mission")
    try:
        startup = number("~startup_timeout", 90.0, 1.0)
        return EveningNode(_results(), startup, _on_lost()).run()
    except (ParameterError, EveningStopped, ServiceError) as error:
        if is_shutdown_requested():  # otherwise it is no error that something was not found
            return EXIT_INTERRUPTED
        print(f"mission: {error}", file=sys.stderr)
    return EXIT_STOPPED


def _on_lost() -> str:
    on_lost = str(rospy.get_param("~on_lost", RESEND))
    if on_lost not in ON_LOST:
        raise ParameterError(f"parameter ~on_lost is {on_lost!r}; it has to be one of {', '.join(ON_LOST)}")
    return on_lost


def _results() -> Path:
    folder = Path(str(rospy.get_param("~results", "results/restaurant")))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f"no folder for the results: {error}; give another one, results:=…") from error
    return folder
