# SPDX-License-Identifier: Apache-2.0
"""The panel of the health: every part that reports on ``/diagnostics``."""

from itertools import islice
from typing import Dict

from diagnostic_msgs.msg import DiagnosticArray

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel, sender_of
from merlin_monitor.state.monitor_model import MonitorModel

#: Nodes that hang after which one look asks no others: each takes 2 s, and the next look waits.
MOST_HANGING = 3


class HealthPanel(Panel):
    """The parts, and which of them are silent."""

    name, title, place, width = "health", "Health", 38, 5

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        self._reports = self.subscribe(
            "/diagnostics",
            DiagnosticArray,
            self._take,
        )

    def look(self, topics: Dict[str, str]) -> None:
        """Asks those that have fallen silent after a report or two: one that reports now and then answers."""
        hanging = (node for node in self.state.health.doubtful if self.ros.hangs(node))
        self.state.inbox.put(self.state.health.hang, list(islice(hanging, MOST_HANGING)))

    def check(self, at: float, wall: float) -> None:
        """Notices silent parts."""
        nodes = self.watch.publishers_of(self._reports.resolved_name)
        self.state.health.check_silence(at, wall, nodes)

    def _take(self, reports: DiagnosticArray, at: float) -> None:
        self.state.health.diagnostics(reports, at, self.ros.silence_clock(), sender_of(reports))
        self.state.refresh_problems(self.ros.silence_clock())
