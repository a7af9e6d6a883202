# SPDX-License-Identifier: Apache-2.0
"""Publishes what a mission does on ``merlin/mission``."""

import threading

import rospy
from merlin_msgs.msg import MissionStatus

from merlin_ros.health import Health
from merlin_ros.publishing import publish

PAUSED_TEXT = "paused: the next goal is sent when the mission is resumed"


class MissionReporter:
    """Publishes MissionStatus, latched.

    :param mission: its name.
    :param tasks: how many it has; 0: not known.
    """

    def __init__(self, mission: str, tasks: int = 0) -> None:
        self._mission = mission
        self._tasks = tasks
        self._lock = threading.RLock()  # guards the fields below and keeps messages in order
        self._task = 0
        self._doing = self._said = "starting"
        self._paused = False
        self._publisher = rospy.Publisher("merlin/mission", MissionStatus, latch=True, queue_size=10)
        self.report(MissionStatus.STARTING, self._doing)

    def task(self, description: str) -> None:
        """A next task begins; for a paused mission that is published when it continues."""
        with self._lock:
            self._task += 1
            self._doing = description
            if not self._paused:
                self.report(MissionStatus.RUNNING, description)

    def paused(self, paused: bool) -> None:
        """The mission was paused, or continues."""
        with self._lock:
            self._paused = paused
            said = (MissionStatus.PAUSED, PAUSED_TEXT) if paused else (MissionStatus.RUNNING, self._doing)
            self.report(*said)

    def report(self, state: int, description: str) -> None:
        """Publishes a state, a constant of MissionStatus, and a sentence."""
        with self._lock:
            self._said = description
            status = MissionStatus(
                mission=self._mission,
                state=state,
                task=self._task,
                tasks=self._tasks,
                description=description,
            )
            status.header.stamp = rospy.Time.now()
            publish(self._publisher, status)

    def health(self) -> Health:
        """What it does; that this is heard shows that its process goes on."""
        return Health(message=self._said)
