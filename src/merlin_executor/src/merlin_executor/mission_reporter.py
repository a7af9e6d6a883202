"""Tells what a mission does, on ``merlin/mission``."""

import threading

import rospy
from merlin_msgs.msg import MissionStatus

from merlin_executor.mission_pause import PAUSED
from merlin_sm.publishing import publish


class MissionReporter:
    """Publishes MissionStatus, latched.

    :param mission: its name.
    :param tasks: how many it has; 0: not known.
    """

    def __init__(self, mission: str, tasks: int = 0) -> None:
        self._status = MissionStatus(mission=mission, tasks=tasks)
        self._lock = threading.RLock()  # guards all the fields
        self._doing = "starting"
        self._paused = False
        self._publisher = rospy.Publisher("merlin/mission", MissionStatus, latch=True, queue_size=10)
        self.report(MissionStatus.STARTING, self._doing)

    def task(self, description: str) -> None:
        """A next task begins; a paused mission tells of it when it goes on."""
        with self._lock:
            self._status.task += 1
            self._doing = description
            if not self._paused:
                self.report(MissionStatus.RUNNING, description)

    def paused(self, paused: bool) -> None:
        """The mission was paused, or goes on."""
        with self._lock:
            self._paused = paused
            if paused:
                self.report(MissionStatus.PAUSED, PAUSED)
            else:
                self.report(MissionStatus.RUNNING, self._doing)

    def report(self, state: int, description: str) -> None:
        """Publishes a state, a constant of MissionStatus, and a sentence."""
        with self._lock:
            self._status.state = state
            self._status.description = description
            self._status.header.stamp = rospy.Time.now()
            publish(self._publisher, self._status)
