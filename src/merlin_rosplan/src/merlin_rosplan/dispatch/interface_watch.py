"""Which action interfaces are alive, from the announcements that each makes every second."""

import threading
from typing import Callable, Dict, Optional, Tuple

DEAD = 5.0  # announcements missed after which the next one is that of a new interface
YOUNG = 5.0  # s


class InterfaceWatch:
    """Remembers when each operator's interface was last heard of; thread-safe.

    :param clock: s, monotonic; should stand still while the simulator is paused.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()  # guards the register
        self._heard: Dict[str, Tuple[float, float]] = {}  # operator -> (when, s since the one before)
        self._first: Dict[str, float] = {}  # operator -> when its present life began

    def announce(self, operator: str) -> None:
        """The interface of an operator has announced itself."""
        now = self._clock()
        with self._lock:
            known = self._heard.get(operator.lower())
            if known is None or now - known[0] > DEAD * max(1.0, known[1]):
                self._first[operator.lower()] = now
            self._heard[operator.lower()] = (now, now - known[0] if known is not None else 0.0)

    def just_announced(self, operator: str) -> bool:
        """Whether an operator's interface was first heard of less than :data:`YOUNG` seconds ago."""
        with self._lock:
            first = self._first.get(operator.lower())
        return first is not None and self._clock() - first < YOUNG

    def seconds_silent(self, operator: str) -> Optional[float]:
        """Seconds since an operator's interface was heard of, None when it never was.

        ROSPlan's interfaces count their second in ROS time: one that announces itself more slowly than once
        per second of ours is given proportionally more of them.
        """
        with self._lock:
            known = self._heard.get(operator.lower())
        if known is None:
            return None
        return (self._clock() - known[0]) / min(max(1.0, known[1]), 10.0)
