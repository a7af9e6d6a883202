"""Names that have to be announced before something begins. Without ROS."""

import threading
from typing import Callable, Iterable, List, Protocol


class Waiting(Protocol):
    """A wait that has an end, as of :class:`merlin_ros.deadline.Deadline`."""

    def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
        """Waits, with the condition held, until the predicate is true or the wait is over."""


class Awaited:
    """The names that are still missing. Thread-safe.

    :param names: that have to be announced.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._changed = threading.Condition()  # guards the names
        self._missing = list(dict.fromkeys(names))

    def heard(self, name: str) -> None:
        """Notes that a name was announced; only awaited ones count."""
        with self._changed:
            if name in self._missing:
                self._missing.remove(name)
                self._changed.notify_all()

    def wait(self, waiting: Waiting) -> List[str]:
        """Waits for all names.

        :return: those that are missing in the end, in the given order.
        """
        with self._changed:
            waiting.wait(self._changed, lambda: not self._missing)
            return list(self._missing)
