# SPDX-License-Identifier: Apache-2.0
"""Pauses and resumes a mission: the services ``merlin/mission/pause`` and ``merlin/mission/resume``."""

import math
import threading
from typing import Callable, ClassVar, List, Optional, Set, Tuple

import rospy
from merlin_msgs.msg import ExecutorStatus
from std_srvs.srv import Trigger, TriggerResponse

from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.resending import END
from merlin_ros.deadline import Deadline


class HoldWatch:
    """Follows ``merlin/status``.

    :param changed: guards its fields, and is notified when the Executor has said something.
    """

    def __init__(self, changed: threading.Condition) -> None:
        self._changed = changed
        self.waits = ""
        """What the Executor waits for, a sentence; empty: no base is held."""
        self.releases = 0
        """How many holds have ended so far."""
        self.released: Set[str] = set()
        """The requests that were cancelled before the last one ended; their results may be heard later."""
        self.released_at = -math.inf
        """When the last one ended, s of the Executor's ROS time."""
        self.times_set_back = 0
        """How often that clock was set back."""
        self._stamp = -math.inf  # of the last status
        self._cancelled: Set[str] = set()  # since a request ran
        self._status = rospy.Subscriber("merlin/status", ExecutorStatus, self._receive, tcp_nodelay=True)

    def wait_released(self, tell: Callable[[str], None]) -> None:
        """Waits until no base is held, or the node shuts down.

        :param tell: called with what it waits for, unless it does not wait.
        """
        with self._changed:
            if self.waits:
                tell(self.waits)
            Deadline(None).wait(self._changed, lambda: not self.waits)

    def close(self) -> None:
        """Ends its subscription."""
        self._status.unregister()

    def _receive(self, status: ExecutorStatus) -> None:
        with self._changed:
            running = {status.request, *(each.request for each in status.together)}
            if status.state == ExecutorStatus.CANCELLING:
                self._cancelled |= running
            stamp = status.header.stamp.to_sec()
            if stamp < self._stamp:
                self.times_set_back += 1
                self.released_at = -math.inf
            self._stamp = stamp
            if self.waits and not status.waits:
                self.releases += 1
                self.released_at = stamp
                self.released = set(self._cancelled)
            if status.state == ExecutorStatus.RUNNING:  # what is cancelled later waits for a later release
                self._cancelled = set()
                self.released -= running
            self.waits = status.waits
            self._changed.notify_all()


#: The answer to a request to pause or resume: whether it was done, and words.
Switched = Tuple[bool, str]


class PauseSwitch:
    """Whether a mission is paused, and what a request to pause or resume is answered. Not thread-safe."""

    def __init__(self) -> None:
        self.paused = False
        """Whether it is paused."""
        self._asked = False  # by an operator
        self._over = True

    def begin(self) -> None:
        """Called when the mission begins: an earlier pause no longer counts."""
        self.paused = self._asked = self._over = False

    def end(self) -> None:
        """The mission has ended."""
        self._over = True

    def set(self, paused: bool, asked: bool = True) -> Switched:
        """The mission is to pause, or to continue.

        :param asked: by an operator; otherwise it pauses itself, and ends no pause that an operator wants.
        """
        if self._over:
            return False, "The mission has ended."
        if not asked and self._asked:
            return False, "An operator has paused the mission."
        self._asked, wanted = asked and paused, self._asked
        if self.paused == paused and wanted == self._asked:
            return False, "The mission is paused already." if paused else "The mission is not paused."
        self.paused = paused
        return True, "Paused: no further goal is sent." if paused else "The mission continues."


#: What a mission does when an operator stops the robot or cancels its goals: it waits for the release, or to
#: be resumed, and sends them again; it goes on without them; (END) it ends.
WAIT, SKIP = "wait", "skip"
ON_CANCEL = (WAIT, SKIP, END)


class MissionPause:
    """A paused mission sends no further goal; the one under way continues to its end.

    Use it as a context manager around the mission: the services exist that long.

    :param on_change: called with whether the mission is paused now, in the service's thread and in the order
        of the changes; never after the context has ended. It must not block.
    :param on_cancel: WAIT, SKIP or END.
    :raises ValueError: for another word.
    """

    of_mission: ClassVar[Optional["MissionPause"]] = None
    """That of the mission that this process runs."""

    def __init__(self, on_change: Callable[[bool], None], on_cancel: str = WAIT) -> None:
        if on_cancel not in ON_CANCEL:
            raise ValueError(f"on_cancel is {on_cancel!r}; it has to be one of {', '.join(ON_CANCEL)}")
        self._on_change = on_change
        self._on_cancel = on_cancel
        self._holds: Optional[HoldWatch] = None
        self._changed = threading.Condition()  # guards the switch, and the order of the calls
        self._switch = PauseSwitch()
        self._services: List[rospy.Service] = []

    def __enter__(self) -> "MissionPause":
        with self._changed:
            self._switch.begin()
        MissionPause.of_mission = self
        self._holds = HoldWatch(self._changed)
        self._services = [
            rospy.Service("merlin/mission/pause", Trigger, lambda _: self._set(True)),
            rospy.Service("merlin/mission/resume", Trigger, lambda _: self._set(False)),
        ]
        return self

    def __exit__(self, *_: object) -> None:
        MissionPause.of_mission = None
        with self._changed:
            self._switch.end()
        for service in self._services:
            service.shutdown("the mission has ended")
        self._services = []
        if self._holds is not None:
            self._holds.close()

    def wait(self, stopped: Callable[[], bool]) -> None:
        """Returns when the mission is not paused, or stopped, or the node shuts down.

        :param stopped: looked at after each :meth:`wake`.
        """
        with self._changed:
            Deadline(None).wait(self._changed, lambda: not self._switch.paused or stopped())

    def skips(self, request: ExecutorRequest) -> bool:
        """Whether the mission goes on without the goals of a request that has ended."""
        return self._on_cancel == SKIP and request.taken_back

    def again(self, request: ExecutorRequest, stopped: Callable[[], bool]) -> bool:
        """Whether the goals of a request that has ended are to be sent again, as an operator took them back.

        Waits until he lets the mission go on: it is resumed, or a hold of the base is released; or it was
        released already, while the request was being cancelled.

        :param stopped: looked at after each :meth:`wake`; then it is False.
        """
        holds = self._holds
        if self._on_cancel != WAIT or holds is None or not request.taken_back:
            return False
        with self._changed:
            releases, set_back = holds.releases, holds.times_set_back

            def released_later() -> bool:
                # Statuses of an older release may be read behind the result.
                older = holds.released_at < request.ended_at and holds.times_set_back == set_back
                return holds.releases > releases and (request.id in holds.released or not older)

            # One that only waited was not seen to be cancelled, but has ended at once.
            released = request.id in holds.released or request.ended_at <= holds.released_at
            if holds.waits or not released:
                self._set_now(True, asked=False)
                Deadline(None).wait(
                    self._changed, lambda: stopped() or not self._switch.paused or released_later()
                )
                self._set_now(False, asked=False)
        return not stopped() and not rospy.is_shutdown()

    def wake(self) -> None:
        """Wakes waiters so that they re-check `stopped`."""
        with self._changed:
            self._changed.notify_all()

    def _set(self, paused: bool) -> TriggerResponse:
        with self._changed:
            return TriggerResponse(*self._set_now(paused))

    def _set_now(self, paused: bool, asked: bool = True) -> Switched:
        """Called with the lock held."""
        switched = self._switch.set(paused, asked)
        if switched[0]:
            self._changed.notify_all()
            self._on_change(paused)
        return switched
