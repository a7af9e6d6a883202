# SPDX-License-Identifier: Apache-2.0
"""The panel of the velocity guards: whether the bases may drive."""

from typing import Any, Dict

from merlin_msgs.msg import GuardStatus

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.state.monitor_model import MonitorModel

TOPIC = "merlin/guard"
MOST_GUARDS = 50  # any node can name robots without end


class GuardPanel(Panel):
    """What the guards below the monitor's namespace say; shown while a base may not drive."""

    name, place = "guard", 1

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
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
