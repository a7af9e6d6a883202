"""How fast the simulation runs during a mission.

Deliberation takes wall time, so a simulation at factor 5 makes it look five times as long. Under the
`adaptive` policy the factor is 1 from a goal to its first action and from just before a cancel until the
Executor is idle, and the requested one otherwise.
"""

import threading
from typing import Callable

POLICIES = ("constant", "adaptive")
CANCEL_AHEAD = 1.0
"""ROS time before a cancel from which on the factor is 1, s."""


class RealTimeFactor:
    """Sets the simulator's factor at the moments of a task.

    One thread may call each method; what arrives out of order (an action that starts while the task is
    already being cancelled) changes nothing.
    """

    def __init__(self, policy: str, factor: float, set_factor: Callable[[float], None]) -> None:
        """
        Parameters:
            policy: one of POLICIES.
            factor: simulated seconds per second; 0: as fast as possible.
            set_factor: tells the simulator.

        Raises:
            ValueError: an unknown policy or a negative factor.
        """
        if policy not in POLICIES:
            raise ValueError(f"rtf_policy '{policy}' is not one of {', '.join(POLICIES)}")
        if not 0.0 <= factor < float("inf"):
            raise ValueError(f"a real-time factor of {factor} is none; give 0 (fast) or more")
        self._adaptive = policy == "adaptive" and factor != 1.0
        self._factor = factor
        self._set_factor = set_factor
        self._lock = threading.Lock()  # guards the fields below, and the order of calls to the simulator
        self._current = -1.0
        self._deliberating = False

    def mission_starts(self) -> None:
        """Before the first task."""
        self._change(1.0 if self._adaptive else self._factor, deliberating=True)

    def task_starts(self) -> None:
        """Before a goal is sent."""
        if self._adaptive:
            self._change(1.0, deliberating=True)

    def action_starts(self) -> None:
        """An action was dispatched."""
        if self._adaptive:
            self._change(self._factor, deliberating=False, only_when=True)

    def cancel_is_near(self) -> None:
        """A little before a task is cancelled."""
        if self._adaptive:
            self._change(1.0, deliberating=False)

    def _change(self, factor: float, deliberating: bool, only_when: bool = False) -> None:
        with self._lock:
            if only_when and not self._deliberating:
                return
            self._deliberating = deliberating
            if factor != self._current:
                self._set_factor(factor)
                self._current = factor
