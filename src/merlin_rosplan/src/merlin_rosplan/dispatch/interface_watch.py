# SPDX-License-Identifier: Apache-2.0
"""Which action interfaces are alive, from the announcements that each makes every second."""

import threading
from typing import Callable, Optional

from merlin_ros.work.liveness import Limits, Liveness

LIMITS = Limits(
    gone=5.0,  # the next announcement is that of a new interface
    keep=60.0,
    period=1.0,  # ROSPlan's interfaces count their second in ROS time, which may pass more slowly than ours
    settle=0.9,
)
OPERATORS = 1000  # whose announcements are remembered; any node may make some
JUST_ANNOUNCED = 5.0  # s after the first announcement
#: s between two looks from which this process may have been stalled; a dispatch looks oftener.
LONGEST_LOOK = 2.2


class InterfaceWatch:
    """Remembers when each operator's interface was last announced; thread-safe.

    Where this process was stalled, no interface was silent: announcements may wait to be read.

    :param clock: s, monotonic; should stand still while the simulator is paused.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._lock = threading.Lock()  # guards the fields below
        self._looked = clock()
        self._interfaces: Liveness[str] = Liveness(LIMITS, OPERATORS)

    def announce(self, operator: str) -> None:
        """The interface of an operator has announced itself."""
        with self._lock:
            self._look().heard(operator.lower())

    def just_announced(self, operator: str) -> bool:
        """Whether an interface was first announced less than :data:`JUST_ANNOUNCED` seconds ago."""
        with self._lock:
            return self._look().age(operator.lower()) < JUST_ANNOUNCED

    def seconds_silent(self, operator: str) -> Optional[float]:
        """Seconds since the last announcement of an interface, None without one.

        One that announces itself more slowly than once per second is given proportionally more of them.
        """
        with self._lock:
            name = operator.lower()
            interfaces = self._look()
            return interfaces.silence(name) if name in interfaces else None

    def _look(self) -> Liveness[str]:
        """The interfaces as they are now; called with the lock held."""
        now = self._clock()
        passed, self._looked = now - self._looked, now
        self._interfaces.pass_time(passed, stalled=passed > LONGEST_LOOK)
        return self._interfaces
