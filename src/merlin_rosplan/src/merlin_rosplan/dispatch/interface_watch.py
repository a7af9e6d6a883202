"""Which action interfaces are alive, from the announcements that each makes every second."""

import math
import threading
from typing import Callable, Dict, Optional, Tuple

DEAD = 5.0  # announcements missed after which the next one is that of a new interface
OPERATORS = 1000  # whose announcements are remembered; any node may make some
KEEP = 60.0  # s of silence after which one may be forgotten for another
JUST_ANNOUNCED = 5.0  # s after the first announcement
LONGEST_LOOK = (
    2.2  # s between two looks from which this process may have been stalled; a dispatch looks oftener
)
GRACE = 0.9  # s after that in which what an interface that lives has announced is read


class InterfaceWatch:
    """Remembers when each operator's interface was last announced; thread-safe.

    Where this process was stalled, no interface was silent: announcements may wait to be read.

    :param clock: s, monotonic; should stand still while the simulator is paused.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()  # guards the register
        # Operator -> (when, s since the one before); the one that is silent for longest first.
        self._heard: Dict[str, Tuple[float, float]] = {}
        self._first: Dict[str, float] = {}  # operator -> when its present interface began
        self._looked, self._back, self._gap = (
            clock(),
            -math.inf,
            0.0,
        )  # last look, last end of a gap, its length

    def announce(self, operator: str) -> None:
        """The interface of an operator has announced itself."""
        with self._lock:
            now = self._look()
            name = operator.lower()
            if name not in self._heard and not self._has_room(now):
                return
            known = self._heard.pop(name, None)
            if known is None or now - known[0] > DEAD * max(1.0, known[1]):
                self._first[name] = now
            self._heard[name] = (now, now - known[0] if known is not None else 0.0)

    def just_announced(self, operator: str) -> bool:
        """Whether an interface was first announced less than :data:`JUST_ANNOUNCED` seconds ago."""
        with self._lock:
            first = self._first.get(operator.lower())
        return first is not None and self._clock() - first < JUST_ANNOUNCED

    def seconds_silent(self, operator: str) -> Optional[float]:
        """Seconds since the last announcement of an interface, None without one.

        ROSPlan's interfaces count their second in ROS time: one that announces itself more slowly than once
        per second of ours is given proportionally more of them.
        """
        with self._lock:
            now = self._look()
            known = self._heard.get(operator.lower())
            if known is None:
                return None
            stalled = self._gap if known[0] < self._back and now - self._back < GRACE else 0.0
        return (now - known[0] - stalled) / min(max(1.0, known[1]), 10.0)

    def _look(self) -> float:
        """The time; notes a gap between two looks. Called with the lock held."""
        now = self._clock()
        if now - self._looked > LONGEST_LOOK:
            self._back, self._gap = now, now - self._looked
        self._looked = now
        return now

    def _has_room(self, now: float) -> bool:
        """Whether another operator can be remembered; one that has been silent for long is forgotten."""
        if len(self._heard) < OPERATORS:
            return True
        oldest = next(iter(self._heard))
        if now - self._heard[oldest][0] <= KEEP:
            return False
        del self._heard[oldest]
        self._first.pop(oldest, None)
        return True
