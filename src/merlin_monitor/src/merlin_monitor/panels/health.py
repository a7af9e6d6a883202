# SPDX-License-Identifier: Apache-2.0
"""The panel of the health: every part that reports on ``/diagnostics``."""

from itertools import islice
from typing import Any, Dict

from diagnostic_msgs.msg import DiagnosticArray
from merlin_msgs.msg import GuardStatus

from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.actions.peers import sender_of

#: Nodes that hang after which one look asks no others: each takes 2 s, and the next look waits.
MOST_HANGING = 3


class HealthPanel(Panel):
    """The parts, and which of them are silent."""

    name, title, place, width = "health", "Health", 38, 5

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._reports = self.subscribe("/diagnostics", DiagnosticArray, self._take)

    def look(self, topics: Dict[str, str]) -> None:
        """Asks those that have fallen silent after a report or two: one that reports now and then answers."""
        hanging = (node for node in self.state.health.doubtful if self.ros.hangs(node))
        self.state.inbox.put(self.state.health.hang, list(islice(hanging, MOST_HANGING)))

    def check(self, at: float, wall: float) -> None:
        """Notices silent parts."""
        nodes = self.ros.publishers_of(self._reports.resolved_name)
        self.state.health.check_silence(at, wall, nodes)

    def _take(self, reports: DiagnosticArray, at: float) -> None:
        self.state.health.diagnostics(reports, at, self.ros.silence_clock(), sender_of(reports))
        self.state.refresh_problems(self.ros.silence_clock())


TOPIC = "merlin/guard"
MOST_GUARDS = 50  # any node can name robots without end


class GuardPanel(Panel):
    """What the guards below the monitor's namespace say; shown while a base may not drive."""

    name, place = "guard", 1

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._guard = self.subscribe(TOPIC, GuardStatus, self._take)
        self._robots: Dict[str, Any] = {}  # of the watch's thread: the subscribers of the others

    def look(self, topics: Dict[str, str]) -> None:
        """Finds the guards of several robots."""
        own = self.ros.namespace
        found = {
            topic[len(own) : -len(TOPIC)].strip("/")
            for topic, kind in topics.items()
            if kind == GuardStatus._type and topic.startswith(own) and topic.endswith(f"/{TOPIC}")
        } - {""}
        for robot in sorted(set(self._robots) - found):
            self._robots.pop(robot).unregister()
            self._met(robot, False)
        for robot in sorted(found - set(self._robots))[: MOST_GUARDS - len(self._robots)]:
            self._robots[robot] = self.subscribe(
                f"{robot}/{TOPIC}", GuardStatus, lambda status, at, robot=robot: self._take(status, at, robot)
            )
            self._met(robot, True)

    def check(self, at: float, wall: float) -> None:
        """Notices a silent guard."""
        self.state.guard.check_silence(at, wall)

    def _met(self, robot: str, there: bool) -> None:
        self.state.inbox.put(self.state.guard.met, robot, there, self.ros.silence_clock())
        self.state.on_guard(robot, there)

    def _take(self, status: GuardStatus, at: float, robot: str = "") -> None:
        self.state.guard.status(status, at, self.ros.silence_clock(), robot)
        self.state.now.refresh()
        self.state.refresh_problems(self.ros.silence_clock())
