"""The section of the history: the newest events; older ones are asked for page by page."""

import threading
from collections import deque
from typing import Any, Deque, Dict, List

from merlin_monitor.state.state_tree import StateTree

SECTION = "history"
NEWEST = 200  # events in the state


class HistorySection:
    """Keeps the section ``history`` of the state."""

    def __init__(self, tree: StateTree) -> None:
        self._tree = tree
        self._lock = threading.Lock()  # guards _shown: the first page comes from another thread
        self._shown: Deque[str] = deque()
        tree.set(SECTION, "events", {})

    def add(self, events: List[Dict[str, Any]]) -> None:
        """Shows stored events."""
        with self._lock:
            for event in events[-NEWEST:]:
                key = str(event["id"])
                self._tree.set(SECTION, "events", key, event)
                self._shown.append(key)
            while len(self._shown) > NEWEST:
                self._tree.remove(SECTION, "events", self._shown.popleft())
