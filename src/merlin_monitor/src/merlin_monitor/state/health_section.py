"""The section of the health: what every part tells on /diagnostics, and who has fallen silent."""

from typing import Any, Dict, List

from merlin_monitor.state.events import Event, Tell
from merlin_monitor.state.state_tree import StateTree

SECTION = "health"
LEVELS = ("ok", "warning", "error", "stale")
SILENT_AFTER = 2.5  # s of wall time; our nodes report once per second
PERIODS = 2.5  # of its own, after which a part that reports less often is silent
FIRST_PERIOD = 2.0  # s, assumed of a part that has reported once
LONGEST_PERIOD = 30.0  # s
REGULAR = 3  # reports, from which on a part is expected to report again
MOST_PARTS = 500


class HealthSection:
    """Keeps the section ``health`` of the state."""

    def __init__(self, tree: StateTree, tell: Tell) -> None:
        self._tree = tree
        self._tell = tell
        self._seen: Dict[str, float] = {}
        self._periods: Dict[str, float] = {}
        self._reports: Dict[str, int] = {}
        tree.set(SECTION, "parts", {})

    def diagnostics(self, message: Any, at: float, wall: float) -> None:
        """Takes a message with the fields of diagnostic_msgs/DiagnosticArray."""
        for status in message.status:
            if status.name not in self._seen and len(self._seen) >= MOST_PARTS:
                continue
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            word = LEVELS[level] if 0 <= level < len(LEVELS) else str(level)
            before = self._tree.get(SECTION, "parts", status.name, "level")
            was_silent = self._tree.get(SECTION, "parts", status.name, "silent", default=False)
            self._note_period(status.name, wall)
            self._seen[status.name] = wall
            values = [[pair.key, pair.value] for pair in status.values]
            for field, value in (
                ("level", word),
                ("message", status.message),
                ("values", values),
                ("silent", False),
            ):
                self._tree.set(SECTION, "parts", status.name, field, value)
            if was_silent:
                self._tell(Event("health", f"{status.name} is heard again: {status.message}", at))
            elif before != word and (before is not None or word != "ok"):
                self._tell(Event("health", f"{status.name}: {word}: {status.message}", at))

    def silent_nodes(self) -> List[str]:
        """Nodes that have reported regularly and of which every part is silent, without the leading slash.

        The name of a part begins with that of its node, a colon and a blank, as diagnostic_updater writes it.
        """
        silent: Dict[str, bool] = {}
        for name, reports in self._reports.items():
            if reports < REGULAR:
                continue
            node = name.partition(": ")[0]
            part = bool(self._tree.get(SECTION, "parts", name, "silent", default=False))
            silent[node] = silent.get(node, True) and part
        return [node for node, is_silent in silent.items() if is_silent]

    def check_silence(self, at: float, wall: float) -> None:
        """Marks parts that have not been heard of for long."""
        for name, seen in self._seen.items():
            silent = wall - seen > max(SILENT_AFTER, PERIODS * self._periods[name])
            if self._tree.set(SECTION, "parts", name, "silent", silent) and silent:
                self._tell(Event("health", f"{name} has fallen silent", at))

    def _note_period(self, name: str, wall: float) -> None:
        """Learns how often a part reports; one long pause is forgotten within a few reports."""
        self._reports[name] = self._reports.get(name, 0) + 1
        if name not in self._seen:
            self._periods[name] = FIRST_PERIOD
            return
        last = min(LONGEST_PERIOD, wall - self._seen[name])
        self._periods[name] = max(last, self._periods[name] / 2)
