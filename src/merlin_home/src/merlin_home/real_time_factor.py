"""How fast the simulation runs during a mission.

Thinking takes wall time, so a simulation at factor 5 makes it look five times as long. Under the `adaptive`
policy the factor is 1 whenever the robot waits for software: from a goal until a second after its first
action was dispatched (the path has been planned by then), for a second after every further dispatch (the
question has been synthesised), and from a second before a cancel until the Executor is idle. Otherwise it is
the requested one.
"""

import threading
from typing import Callable

POLICIES = ("constant", "adaptive")
CANCEL_AHEAD = 1.0
"""ROS time before a cancel from which on the factor is 1, s."""
REACTION = 1.0
"""ROS time after a dispatch in which the factor is 1, s."""

CallAfter = Callable[[float, Callable[[], None]], Callable[[], None]]
"""Calls a function after some ROS time (s) in another thread; returns what prevents that."""


class RealTimeFactor:
    """Sets the simulator's factor at the moments of a task; any thread may tell of them."""

    def __init__(
        self, policy: str, factor: float, set_factor: Callable[[float], None], call_after: CallAfter
    ) -> None:
        """
        Parameters:
            policy: one of POLICIES.
            factor: simulated seconds per second; 0: as fast as possible.
            set_factor: tells the simulator.
            call_after: the timer.

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
        self._call_after = call_after
        self._lock = threading.Lock()  # guards the fields below, and the order of calls to the simulator
        self._current = -1.0
        self._moment = 0  # counts what happened; a timer of an earlier moment changes nothing
        self._ending = False

    def mission_starts(self) -> None:
        """Before the first task."""
        with self._lock:
            self._set(1.0 if self._adaptive else self._factor)

    def task_starts(self) -> None:
        """Before a goal is sent."""
        self._slow_down(ending=False)

    def action_starts(self) -> None:
        """An action was dispatched."""
        if not self._adaptive:
            return
        with self._lock:
            if self._ending:
                return  # dispatched while the task is already being cancelled
            self._moment += 1
            moment = self._moment
            self._set(1.0)
        self._call_after(REACTION, lambda: self._speed_up(moment))

    def cancel_is_near(self) -> None:
        """A little before a task is cancelled."""
        self._slow_down(ending=True)

    def _slow_down(self, ending: bool) -> None:
        if not self._adaptive:
            return
        with self._lock:
            self._moment += 1
            self._ending = ending
            self._set(1.0)

    def _speed_up(self, moment: int) -> None:
        with self._lock:
            if moment == self._moment:
                self._set(self._factor)

    def _set(self, factor: float) -> None:
        """With the lock held."""
        if factor != self._current:
            self._set_factor(factor)
            self._current = factor
