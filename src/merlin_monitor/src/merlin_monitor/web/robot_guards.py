# SPDX-License-Identifier: Apache-2.0
"""The velocity guards of all robots below the monitor's namespace: stops, releases, and which of them hold.

A guard gets a stop on a topic whose connection is there already, and its own status says whether it obeyed.
"""

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Callable, Dict, Optional

import rospy
from merlin_msgs.msg import GuardStatus
from std_msgs.msg import String
from std_srvs.srv import Trigger

from merlin_executor.core.base_hold import hold_words, holder_of
from merlin_monitor.web.page_control import ControlError
from merlin_ros.alarms import call_later
from merlin_ros.service_proxy import ServiceError, ServiceProxy

ANSWERS = 1.0  # s of wall time
READ = 0.2  # s of this process's time, after which the words of before a stop have been read
RELEASED = 5.0  # s of wall time; one that is late is carried out all the same, and must not be called refused
START = 10.0  # s of wall time in which a monitor that begins hears the guards there are
#: What a guard says of those who stop the base of one robot alone: nodes, and the button of a joystick.
ONE_ROBOT = ("/", "an unknown node", "button ")
FRESH = 1.5  # s of wall time for which the word of a guard counts; it sends one every 0.5 s


class RobotGuards:
    """Guards by the names of their robots; the one of the monitor's own namespace has the empty name.

    A stop stands until the release: a guard that has not confirmed it, that joins or is back, gets it again
    with each word of its own. A monitor that begins takes up the stop of an operator that a guard tells it.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards the fields below, and those of each guard
        self._guards: Dict[str, _Guard] = {}
        self._by = ""  # whose stop stands
        self._stops = 0
        self._begins_until = time.monotonic() + START
        self.follow("", True)

    @property
    def stop_stands(self) -> bool:
        """Whether a stop has been asked for, and no release since."""
        return bool(self._by)

    def follow(self, robot: str, there: bool) -> None:
        """Begins or ends to follow the guard of a robot; from one thread."""
        guard = _Guard(robot, self._receive) if there else None
        with self._changed:
            gone = self._guards.pop(robot, None)
            if guard is not None:
                self._guards[robot] = guard
        if gone is not None:
            gone.close()

    def stop(self, by: str) -> None:
        """Has all guards hold their bases.

        One that seems to do so gets the stop, too: that its base has been released elsewhere may be unread.
        Held bases keep their first holder.
        """
        with self._changed:
            self._by = by
            self._stops += 1
            number, guards = self._stops, list(self._guards.values())
            for guard in guards:
                guard.confirmed, guard.old = False, True
        for guard in guards:
            guard.stops.publish(String(by))
        call_later(READ, lambda: self._has_read(number))

    def _has_read(self, stop: int) -> None:
        with self._changed:
            for guard in self._guards.values():
                guard.old = guard.old and stop != self._stops

    def wait_held(self, limit: float = ANSWERS) -> Dict[str, bool]:
        """Waits for the guards to confirm a stop; returns which have, by their robots.

        :param limit: s of wall time.
        """
        with self._changed:
            self._changed.wait_for(lambda: all(guard.confirmed for guard in self._counting().values()), limit)
            return {robot: guard.confirmed for robot, guard in self._counting().items()}

    def holders_but(self, by: str) -> str:
        """Who holds bases beside an operator, and since when; empty: no other operator."""
        return self._holders(lambda guard, reason: holder_of(reason) != by)

    def holders_now(self) -> str:
        """Who holds bases, and since when; empty: no guard says so now."""
        return self._holders(lambda guard, reason: not guard.silent)

    def _holders(self, counts: Callable[["_Guard", str], bool]) -> str:
        with self._changed:
            return " and ".join(
                hold_words(robot, guard.status.reason, guard.status.since.to_sec())
                for robot, guard in self._guards.items()
                if guard.status is not None and guard.stopped and counts(guard, guard.status.reason)
            )

    def release(self) -> Dict[str, str]:
        """Releases the bases that are held, all at once; returns why one was not, by their robots."""
        with self._changed:
            self._by, self._begins_until = "", -math.inf
            known = self._counting()
            held = {robot: guard for robot, guard in known.items() if guard.stopped} or known
        with ThreadPoolExecutor(len(held), "release") as pool:
            return dict(zip(held, pool.map(_released, held.values())))

    def _counting(self) -> Dict[str, "_Guard"]:
        """Called with the lock held: among several robots the one without a name needs no guard."""
        return {
            robot: guard
            for robot, guard in self._guards.items()
            if robot or guard.status is not None or len(self._guards) == 1
        }

    def _receive(self, guard: "_Guard", status: GuardStatus) -> None:
        with self._changed:
            was_gone, held_by = guard.silent, guard.held_by
            if guard.status is None and time.monotonic() < self._begins_until:
                self._by = self._by or _stopped_all(status)
            guard.status, guard.heard = status, time.monotonic()
            answers = not guard.old or (guard.held_by == self._by != held_by)
            guard.confirmed = (guard.stopped and answers) or (guard.confirmed and not was_gone)
            if all(each.confirmed and not each.stopped for each in self._counting().values()):
                self._by = ""  # all have been released elsewhere
            by = "" if guard.confirmed else self._by
            self._changed.notify_all()
        if by:
            guard.stops.publish(String(by))


class _Guard:
    """The guard of one base; `RobotGuards` owns the fields.

    :ivar confirmed: whether it has held its base since the last stop.
    :ivar old: whether what it said before the last stop may be unread, but for what names its operator.
    """

    def __init__(self, robot: str, receive: Callable[["_Guard", GuardStatus], None]) -> None:
        topics = f"{robot}/merlin" if robot else "merlin"
        self.status: Optional[GuardStatus] = None
        self.heard = 0.0
        self.confirmed = self.old = False
        self.stops = rospy.Publisher(f"{topics}/stop_by", String, queue_size=10, tcp_nodelay=True)
        self.release = ServiceProxy(f"{topics}/release", Trigger, timeout=RELEASED)
        self._subscriber = rospy.Subscriber(
            f"{topics}/guard", GuardStatus, lambda status: receive(self, status), tcp_nodelay=True
        )

    @property
    def stopped(self) -> bool:
        """Whether it holds its base, as it has said last."""
        return self.status is not None and self.status.state == GuardStatus.STOPPED

    @property
    def held_by(self) -> str:
        """The operator who holds its base, as it has said last; empty: none, or it names none."""
        return holder_of(self.status.reason) if self.status is not None and self.stopped else ""

    @property
    def silent(self) -> bool:
        """Whether it says nothing."""
        return time.monotonic() - self.heard > FRESH

    def close(self) -> None:
        """Ends its topics."""
        for topic in (self.stops, self._subscriber):
            topic.unregister()
        self.release.close()


def _stopped_all(status: GuardStatus) -> str:
    """The operator who has stopped all robots, of what one guard says; empty: there is none."""
    by = holder_of(status.reason) if status.state == GuardStatus.STOPPED else ""
    return "" if by.startswith(ONE_ROBOT) else by


def _released(guard: _Guard) -> str:
    try:
        ask(guard.release, "not released")
    except ControlError as error:
        return str(error)
    return ""


def ask(service: ServiceProxy, otherwise: str) -> str:
    """Calls a service of the type Trigger; returns its answer.

    :raises ControlError: beginning with the text `otherwise`.
    """
    if not service.available():
        raise ControlError(f"{otherwise}: nothing offers {service.name}.")
    try:
        answer = service()
    except ServiceError as error:
        raise ControlError(f"{otherwise}: {error}") from error
    if not answer.success:
        raise ControlError(f"{otherwise}: {answer.message}")
    return str(answer.message)
