"""The panel of the velocity guard: whether the base may drive."""

from merlin_msgs.msg import GuardStatus

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.state.monitor_model import MonitorModel


class GuardPanel(Panel):
    """What the guard says; shown while the base may not drive."""

    name, place = "guard", 1

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        self._guard = self.subscribe("merlin/guard", GuardStatus, self._take)

    def check(self, at: float, wall: float) -> None:
        """Notices a silent guard."""
        self.state.guard.check_silence(at, wall)

    def _take(self, status: GuardStatus, at: float) -> None:
        self.state.guard.status(status, at, self.ros.wall())
        self.state.now.refresh()
