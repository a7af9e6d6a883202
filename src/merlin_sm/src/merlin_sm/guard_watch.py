"""Whether the velocity guard lets a drive begin: no guard, no new drive."""

import math
import threading
import time
from typing import Callable, Optional

import rospy
from merlin_msgs.msg import GuardStatus

from merlin_ros.alarms import wait_ticks
from merlin_ros.master.master_link import MasterSilent, get_param

EXPECTED_PARAM = "merlin/guard_expected"
STATUS_TOPIC = "merlin/guard"
FRESH = 1.5  # s of wall time for which a status counts; the guard sends one every 0.5 s, paused or not
APART = 0.2  # s; nearer to each other, two statuses may have waited in this process
WAIT = 4.0  # s of wall time to wait for one: what a guard takes to come back on a busy machine

OFF = "the velocity guard is switched off (guard:=false): nothing stops the base when MERLIN fails"
SILENT = "the velocity guard is silent; nothing drives without it"


class GuardWatch:
    """Listens to the guard of this robot, where the parameter ``merlin/guard_expected`` says there is one."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards the fields below
        self._status: Optional[GuardStatus] = None
        self._heard_at = 0.0
        self._doubted = -math.inf  # when the first status came after a gap
        self._subscriber = rospy.Subscriber(STATUS_TOPIC, GuardStatus, self._receive, tcp_nodelay=True)

    def wake(self) -> None:
        """Wakes a :meth:`why_not`, so that it re-checks its interruption."""
        with self._changed:
            self._changed.notify_all()

    def why_not(self, interrupted: Callable[[], bool] = lambda: False) -> str:
        """Why no drive may begin now; empty: it may. Waits up to 4 s for a guard that is silent.

        :param interrupted: ends the wait when it is true; call :meth:`wake` when that changes.
        """
        with self._changed:
            if self._fresh() and self._status is not None and self._status.state != GuardStatus.STOPPED:
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
                    lambda: self._fresh() or interrupted() or rospy.is_shutdown(), tick
                ),
                WAIT,
            )
            if self._status is None or not self._fresh():
                return SILENT
            if self._status.state == GuardStatus.STOPPED:
                return f"the velocity guard has stopped the base: {self._status.reason}"
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
            self._changed.notify_all()


_watch: Optional[GuardWatch] = None
_watch_lock = threading.Lock()  # guards _watch


def shared_guard_watch() -> GuardWatch:
    """The process's watch; many states share it. Needs an initialised node."""
    global _watch
    with _watch_lock:
        if _watch is None:
            _watch = GuardWatch()
        return _watch
