"""Pauses and resumes a mission: the services ``merlin/mission/pause`` and ``merlin/mission/resume``."""

import threading
from typing import Callable, List

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from merlin_executor.mission.mission_progress import PauseSwitch
from merlin_ros.deadline import Deadline


class MissionPause:
    """A paused mission sends no further goal; the one under way continues to its end.

    Use it as a context manager around the mission: the services exist that long.

    :param on_change: called with whether the mission is paused now, in the service's thread and in the order
        of the changes; never after the context has ended. It must not block.
    """

    def __init__(self, on_change: Callable[[bool], None]) -> None:
        self._on_change = on_change
        self._changed = threading.Condition()  # guards the switch, and the order of the calls
        self._switch = PauseSwitch()
        self._services: List[rospy.Service] = []

    def __enter__(self) -> "MissionPause":
        with self._changed:
            self._switch.begin()
        self._services = [
            rospy.Service("merlin/mission/pause", Trigger, self._pause),
            rospy.Service("merlin/mission/resume", Trigger, self._resume),
        ]
        return self

    def __exit__(self, *_: object) -> None:
        with self._changed:
            self._switch.end()
        for service in self._services:
            service.shutdown("the mission has ended")
        self._services = []

    def wait(self, stopped: Callable[[], bool]) -> None:
        """Returns when the mission is not paused, or stopped, or the node shuts down.

        :param stopped: looked at after each :meth:`wake`.
        """
        with self._changed:
            Deadline(None).wait(self._changed, lambda: not self._switch.paused or stopped())

    def wake(self) -> None:
        """Wakes waiters so that they re-check `stopped`."""
        with self._changed:
            self._changed.notify_all()

    def _pause(self, request: TriggerRequest) -> TriggerResponse:
        return self._set(True)

    def _resume(self, request: TriggerRequest) -> TriggerResponse:
        return self._set(False)

    def _set(self, paused: bool) -> TriggerResponse:
        with self._changed:
            switched = self._switch.set(paused)
            if switched.done:
                self._changed.notify_all()
                self._on_change(paused)
        return TriggerResponse(switched.done, switched.words)
