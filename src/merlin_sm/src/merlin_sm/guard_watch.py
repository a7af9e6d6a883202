# SPDX-License-Identifier: Apache-2.0
"""Whether the velocity guard lets a drive begin: no guard, no new drive."""

import contextlib
import math
import threading
import time
from typing import Callable, Iterator, List, NamedTuple, Optional

import rospy
from merlin_msgs.msg import GuardStatus

from merlin_ros.alarms import wait_ticks
from merlin_ros.master.master_link import MasterSilent, get_param
from merlin_ros.master.publisher_updates import keep_all

EXPECTED_PARAM = "merlin/guard_expected"
STATUS_TOPIC = "merlin/guard"
FRESH = 1.5  # s of wall time for which a status counts; the guard sends one every 0.5 s, paused or not
APART = 0.2  # s; nearer to each other, two statuses may have waited in this process
WAIT = 4.0  # s of wall time to wait for one: what a guard takes to come back on a busy machine
LONG_DRIVE = 1.0  # s of wall time; of a shorter drive the guard may not have reported yet

OFF = "the velocity guard is switched off (guard:=false): nothing stops the base when MERLIN fails"
SILENT = "the velocity guard is silent; nothing drives without it"


class DriveMark(NamedTuple):
    """When a drive began, and how many statuses of the guard had said what by then."""

    begun: float = 0.0
    passing: int = 0
    moving: int = 0
    holding: int = 0


class GuardWatch:
    """Listens to the guard of this robot, where the parameter ``merlin/guard_expected`` says there is one.

    Also a plain node of rospy keeps its connection to the guard then: a drive ends by what the guard says.
    """

    def __init__(self) -> None:
        keep_all()
        self._changed = threading.Condition()  # guards the fields below
        self._status: Optional[GuardStatus] = None
        self._heard_at = 0.0
        self._doubted = -math.inf  # when the first status came after a gap
        self._heard = DriveMark()
        self._held_because = ""
        self._followers: List[Callable[[GuardStatus], None]] = []
        self._subscriber = rospy.Subscriber(STATUS_TOPIC, GuardStatus, self._receive, tcp_nodelay=True)

    def wake(self) -> None:
        """Wakes a :meth:`why_not`, so that it re-checks its interruption."""
        with self._changed:
            self._changed.notify_all()

    def names(self, server: str) -> bool:
        """Whether the guard has said that an action, by its resolved name, moves the base."""
        with self._changed:
            return self._status is not None and server in self._status.servers

    @contextlib.contextmanager
    def followed(self, take: Callable[[GuardStatus], None]) -> Iterator[None]:
        """Has a function called with each status, without a lock, while the context lasts."""
        with self._changed:
            self._followers.append(take)
        try:
            yield
        finally:
            with self._changed:
                self._followers.remove(take)

    def why_not(self, interrupted: Callable[[], bool] = lambda: False, server: str = "") -> str:
        """Why no drive may begin now; empty: it may.

        Waits up to 4 s for a guard that is silent, or does not hear the server yet.

        :param interrupted: ends the wait when it is true; call :meth:`wake` when that changes.
        :param server: resolved name of the action that is to drive; empty: not known.
        """
        with self._changed:
            if self._settled(server) and not self._wrong(server):
                return ""
        try:
            expected = get_param(EXPECTED_PARAM, None)
        except MasterSilent as error:
            return str(error)
        if not expected:
            if expected is not None:
                rospy.logwarn_once(OFF)
            return ""
        with self._changed:
            wait_ticks(
                lambda tick: self._changed.wait_for(
                    lambda: self._settled(server) or interrupted() or rospy.is_shutdown(), tick
                ),
                WAIT,
            )
            return self._wrong(server)

    def mark(self) -> DriveMark:
        """The beginning of a drive, for :meth:`why_unmoved`."""
        with self._changed:
            return self._heard._replace(begun=time.monotonic())

    def why_unmoved(self, mark: DriveMark, server: str) -> str:
        """Why a drive that has arrived cannot have moved the base; empty: it may have.

        Only warns when no velocity came: the base may have been there already.

        :param mark: of its beginning.
        :param server: that says so; of one that the guard does not name it knows nothing.
        """
        with self._changed:
            heard, held, fresh = self._heard, self._held_because, self._fresh()
        if time.monotonic() - mark.begun < LONG_DRIVE or heard.moving > mark.moving or not fresh:
            return ""
        said = f"{server} says that it has arrived, but the velocity guard passed no velocity"
        if heard.holding > mark.holding and heard.passing == mark.passing:
            return f"{said}: {held}"
        rospy.logwarn(f"{said}. Was the robot there already? Does the server publish on cmd_vel_in?")
        return ""

    def _settled(self, server: str) -> bool:
        """Whether waiting changes nothing; called with the lock held, as all below."""
        status = self._status
        if status is None or not self._fresh():
            return False
        known = not server or server in status.heard or server not in status.servers
        return known or status.state == GuardStatus.STOPPED

    def _wrong(self, server: str) -> str:
        status = self._status
        if status is None or not self._fresh():
            return SILENT
        if status.state == GuardStatus.STOPPED:
            return f"the velocity guard has stopped the base: {status.reason}"
        if server and server not in status.servers:
            return (
                f"the velocity guard passes no velocities of {server}: it is not among its motion_servers "
                f"[{', '.join(status.servers)}]"
            )
        if server and server not in status.heard:
            return (
                f"the velocity guard passes no velocities of {server}: it does not hear {server}/status; "
                "see ROS_IP or ROS_HOSTNAME of both computers"
            )
        return ""

    def _fresh(self) -> bool:
        fresh = self._status is not None and time.monotonic() - self._heard_at <= FRESH
        return fresh and self._heard_at - self._doubted >= APART

    def _receive(self, status: GuardStatus) -> None:
        with self._changed:
            now = time.monotonic()
            # Was the guard silent, or this process held up? What waited in it says nothing of now.
            if self._status is not None and now - self._heard_at > FRESH:
                self._doubted = now
            self._status, self._heard_at = status, now
            _, passing, moving, holding = self._heard
            if status.state == GuardStatus.HOLDING:
                self._held_because = status.reason
                holding += 1
            passing += status.state == GuardStatus.PASSING
            self._heard = DriveMark(0.0, passing, moving + status.moving, holding)
            self._changed.notify_all()
            followers = list(self._followers)
        for take in followers:
            take(status)


_watch: Optional[GuardWatch] = None
_watch_lock = threading.Lock()  # guards _watch


def shared_guard_watch() -> GuardWatch:
    """The process's watch; many states share it. Needs an initialised node."""
    global _watch
    with _watch_lock:
        if _watch is None:
            _watch = GuardWatch()
        return _watch
