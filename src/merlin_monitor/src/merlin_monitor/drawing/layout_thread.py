"""A thread that has pictures laid out, so that no caller waits for Graphviz."""

import threading
from typing import Any, Callable, Dict, Optional, Tuple

from merlin_monitor.drawing.graph_layout import LayoutError, layout
from merlin_monitor.drawing.machine_graph import DrawnGraph

Done = Callable[[str, Optional[Dict[str, Any]], str], None]


class LayoutThread:
    """Lays out the newest graph of every name, one after the other.

    :param done: called in this thread with the name and the picture, or the reason why there is no picture.
    """

    def __init__(self, done: Done) -> None:
        self._done = done
        self._changed = threading.Condition()  # guards the fields below
        self._waiting: Dict[str, Callable[[], Optional[DrawnGraph]]] = {}
        self._last: Dict[str, Tuple[DrawnGraph, Optional[Dict[str, Any]], str]] = {}
        self._stopping = False
        self._thread = threading.Thread(target=self._work, name="layout", daemon=True)

    def start(self) -> None:
        """Begins to work."""
        self._thread.start()

    def stop(self) -> None:
        """Ends; a picture under way is not waited for."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()

    def ask(self, name: str, graph: Callable[[], Optional[DrawnGraph]]) -> None:
        """Wants a picture; the graph is made when its turn comes, so the last one asked for is drawn."""
        with self._changed:
            self._waiting[name] = graph
            self._changed.notify_all()

    def draw_waiting(self) -> None:
        """Lays out what waits, in the thread of the caller; instead of `start`."""
        with self._changed:
            waiting, self._waiting = self._waiting, {}
        for name, make in waiting.items():
            self._lay_out(name, make)

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._stopping:
                    self._changed.wait()
                if self._stopping:
                    return
                name = next(iter(self._waiting))
                make = self._waiting.pop(name)
            self._lay_out(name, make)

    def _lay_out(self, name: str, make: Callable[[], Optional[DrawnGraph]]) -> None:
        try:
            picture, reason = self._draw(name, make)
        except Exception as error:  # one strange machine does not end all pictures
            picture, reason = None, f"{type(error).__name__}: {error}"
        self._done(name, picture, reason)

    def _draw(
        self, name: str, make: Callable[[], Optional[DrawnGraph]]
    ) -> Tuple[Optional[Dict[str, Any]], str]:
        graph = make()
        if graph is None or not graph.nodes:
            self._last.pop(name, None)
            return None, ""
        known = self._last.get(name)
        if known is not None and known[0] == graph:
            return known[1], known[2]
        picture: Optional[Dict[str, Any]] = None
        reason = ""
        try:
            picture = layout(graph)
        except LayoutError as error:
            reason = str(error)
        self._last[name] = graph, picture, reason
        return picture, reason
