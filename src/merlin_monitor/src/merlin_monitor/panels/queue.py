# SPDX-License-Identifier: Apache-2.0
"""The panel of the queue: the goals that run and wait."""

from merlin_msgs.msg import GoalQueue

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel


class QueuePanel(Panel):
    """The requests of the Executor."""

    name, title, place, width = "queue", "Queue", 36, 7

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        self._queue = self.subscribe("merlin/queue", GoalQueue, state.now.queue)

    def source(self) -> Source:
        """The Executor."""
        return self.source_of(self._queue)
