"""Tells what a mission does, on ``merlin/mission``."""

import rospy
from merlin_msgs.msg import MissionStatus

from merlin_executor.mission_pause import PAUSED


class MissionReporter:
    """Publishes MissionStatus, latched.

    :param mission: its name.
    :param tasks: how many it has; 0: not known.
    """

    def __init__(self, mission: str, tasks: int = 0) -> None:
        self._status = MissionStatus(mission=mission, tasks=tasks)
        self._described = ""
        self._publisher = rospy.Publisher("merlin/mission", MissionStatus, latch=True, queue_size=10)
        self.report(MissionStatus.STARTING, description="starting")

    def task(self, description: str) -> None:
        """A next task begins."""
        self._status.task += 1
        self.report(MissionStatus.RUNNING, description)

    def paused(self, paused: bool) -> None:
        """The mission was paused, or goes on."""
        if paused:
            self._described = self._status.description
        self.report(
            MissionStatus.PAUSED if paused else MissionStatus.RUNNING, PAUSED if paused else self._described
        )

    def report(self, state: int, description: str) -> None:
        """Publishes a state, a constant of MissionStatus, and a sentence."""
        self._status.state = state
        self._status.description = description
        self._status.header.stamp = rospy.Time.now()
        self._publisher.publish(self._status)
