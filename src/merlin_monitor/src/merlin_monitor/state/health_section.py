"""The section of the health: what every part tells on /diagnostics, and who has fallen silent."""

from typing import Any, Dict

from merlin_monitor.state.events import Event, Tell
from merlin_monitor.state.state_tree import StateTree

SECTION = "health"
LEVELS = ("ok", "warning", "error", "stale")
SILENT_AFTER = 5.0  # s of wall time
MOST_PARTS = 500


class HealthSection:
    """Keeps the section ``health`` of the state."""

    def __init__(self, tree: StateTree, tell: Tell) -> None:
        self._tree = tree
        self._tell = tell
        self._seen: Dict[str, float] = {}
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

    def check_silence(self, at: float, wall: float) -> None:
        """Marks parts that have not been heard of for long."""
        for name, seen in self._seen.items():
            silent = wall - seen > SILENT_AFTER
            if self._tree.set(SECTION, "parts", name, "silent", silent) and silent:
                self._tell(Event("health", f"{name} has fallen silent", at))
