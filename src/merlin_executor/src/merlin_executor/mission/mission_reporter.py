# SPDX-License-Identifier: Apache-2.0
"""Publishes what a mission does on ``merlin/mission``."""

import threading

import rospy
from merlin_msgs.msg import MissionStatus

from merlin_executor.mission.mission_progress import MissionProgress, MissionState
from merlin_ros.health import Health
from merlin_ros.publishing import publish


class MissionReporter:
    """Publishes MissionStatus, latched.

    :param mission: its name.
    :param tasks: how many it has; 0: not known.
    """

    def __init__(self, mission: str, tasks: int = 0) -> None:
        self._mission = mission
        self._tasks = tasks
        self._lock = threading.RLock()  # guards the progress and keeps messages in order
        self._progress = MissionProgress()
        self._publisher = rospy.Publisher("merlin/mission", MissionStatus, latch=True, queue_size=10)
        with self._lock:
            self._publish()

    def task(self, description: str) -> None:
        """A next task begins; for a paused mission that is published when it continues."""
        with self._lock:
            if self._progress.task(description):
                self._publish()

    def paused(self, paused: bool) -> None:
        """The mission was paused, or continues."""
        with self._lock:
            self._progress.pause(paused)
            self._publish()

    def report(self, state: int, description: str) -> None:
        """Publishes a state, a constant of MissionStatus, and a sentence."""
        with self._lock:
            self._progress.report(MissionState(state), description)
            self._publish()

    def health(self) -> Health:
        """What it does; that this is heard shows that its process goes on."""
        return Health(message=self._progress.now.description)

    def _publish(self) -> None:
        now = self._progress.now
        status = MissionStatus(
            mission=self._mission,
            state=int(now.state),
            task=now.task,
            tasks=self._tasks,
            description=now.description,
        )
        status.header.stamp = rospy.Time.now()
        publish(self._publisher, status)
