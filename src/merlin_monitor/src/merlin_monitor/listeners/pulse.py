"""What has no event of its own: time goes on, a part falls silent, the robot moves a little."""

import threading
import time
from typing import Callable, Mapping

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from merlin_msgs.msg import SimStatus

from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel

SAMPLES = 4.0  # per s of wall time
CHECKS = 0.5  # s of wall time between two looks at what is silent


class Pulse:
    """Samples the clock and the robot's pose, follows /diagnostics and the simulator.

    :param state: the model.
    :param sample: called at each sample, in the pulse's thread.
    :param sources: of the sections, asked at each check, in the same thread.
    """

    def __init__(
        self,
        state: MonitorModel,
        sample: Callable[[], None],
        sources: Callable[[], Mapping[str, Source]],
    ) -> None:
        self._state = state
        self._sample = sample
        self._sources = sources
        self._paused = False
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._work, name="pulse", daemon=True)
        self._subscribers = [
            rospy.Subscriber("/diagnostics", DiagnosticArray, self._diagnostics, queue_size=100),
            rospy.Subscriber("/merlin_sim/status", SimStatus, self._simulator, queue_size=10),
        ]

    def start(self) -> None:
        """Begins."""
        rospy.on_shutdown(self.stop)
        self._thread.start()

    def stop(self) -> None:
        """Ends."""
        self._stopped.set()

    def _work(self) -> None:
        checked = 0.0
        while not self._stopped.wait(1.0 / SAMPLES):
            self._sample()
            now = time.monotonic()
            if now - checked >= CHECKS:
                checked = now
                self._state.inbox.put(self._check, rospy.get_time(), now, self._sources())

    def _check(self, at: float, wall: float, sources: Mapping[str, Source]) -> None:
        self._state.tree.set("meta", "time", round(at, 1))
        self._state.machines.check_silence(wall, self._paused)
        self._state.health.check_silence(at, wall)
        self._state.guard.check_silence(at, wall)
        self._state.freshness.check(at, sources)
        self._state.now.refresh()
        self._state.checked(wall)

    def _diagnostics(self, message: DiagnosticArray) -> None:
        self._state.inbox.put(self._state.health.diagnostics, message, rospy.get_time(), time.monotonic())

    def _simulator(self, message: SimStatus) -> None:
        self._paused = message.paused
        factor = round(message.achieved_factor, 1)
        self._state.inbox.put(
            self._state.tree.set, "meta", "simulator", {"paused": message.paused, "factor": factor}
        )
