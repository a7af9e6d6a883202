"""Lets a mission be paused: the services ``merlin/mission/pause`` and ``merlin/mission/resume``."""

import threading
from typing import Callable, List

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from merlin_sm.deadline import Deadline

PAUSED = "paused: the next goal is sent when the mission is resumed"


class MissionPause:
    """A paused mission sends no further goal; the one under way goes on to its end.

    Use it as a context manager around the mission: the services are there that long.

    :param on_change: called with whether the mission is paused now, in the service's thread and in the order
        of the changes; never after the context has ended. It must not block.
    """

    def __init__(self, on_change: Callable[[bool], None]) -> None:
        self._on_change = on_change
        self._changed = threading.Condition()  # guards the two fields below, and the order of the calls
        self._paused = False
        self._over = False
        self._services: List[rospy.Service] = []

    def __enter__(self) -> "MissionPause":
        self._paused = self._over = False
        self._services = [
            rospy.Service("merlin/mission/pause", Trigger, self._pause),
            rospy.Service("merlin/mission/resume", Trigger, self._resume),
        ]
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._over = True
        for service in self._services:
            service.shutdown("the mission has ended")
        self._services = []

    def wait(self, stopped: Callable[[], bool]) -> None:
        """Returns when the mission is not paused, or stopped, or the node shuts down.

        :param stopped: looked at after each :meth:`wake`.
        """
        with self._changed:
            Deadline(None).wait(self._changed, lambda: not self._paused or stopped())

    def wake(self) -> None:
        """Has who waits look again whether the mission was stopped."""
        with self._changed:
            self._changed.notify_all()

    def _pause(self, request: TriggerRequest) -> TriggerResponse:
        return self._set(True, "Paused: no further goal is sent.", "The mission is paused already.")

    def _resume(self, request: TriggerRequest) -> TriggerResponse:
        return self._set(False, "The mission goes on.", "The mission is not paused.")

    def _set(self, paused: bool, done: str, refused: str) -> TriggerResponse:
        with self._changed:
            if self._over:
                return TriggerResponse(False, "The mission has ended.")
            if self._paused == paused:
                return TriggerResponse(False, refused)
            self._paused = paused
            self._changed.notify_all()
            self._on_change(paused)
        return TriggerResponse(True, done)
