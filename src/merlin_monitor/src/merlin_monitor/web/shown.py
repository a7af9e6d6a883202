"""What the web server shows: the present run, or a run that has ended."""

from typing import Optional, Protocol

from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.history.pictures import Pictures
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.state_tree import StateTree


class Shown(Protocol):
    """A :class:`MonitorModel`, an :class:`Archive`, or a fleet."""

    tree: StateTree
    pictures: Pictures

    @property
    def history(self) -> Optional[HistoryReader]:
        """Events, and what was shown; None: none is kept."""

    @property
    def checked_at(self) -> float:
        """When what is shown was checked last, s of ``time.monotonic``."""

    def report(self, event: Event) -> None:
        """Adds an event to the history."""
