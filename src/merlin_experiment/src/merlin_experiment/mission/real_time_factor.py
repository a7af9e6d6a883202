# SPDX-License-Identifier: Apache-2.0
"""How fast the simulation runs during a mission.

Thinking takes wall time, so a simulation at factor 5 makes it look five times as long. Under the `adaptive`
policy the factor is 1 whenever the robot waits for software:

- from a goal until a second after its first dispatch (the path has been planned by then);
- from shortly before the robot arrives until a second after the next dispatch (the question is synthesised);
- from shortly before the question ends;
- from a second before a cancel until the Executor is idle.

Otherwise the factor is the requested one. It is lowered on a machine that cannot keep up: a simulation
that outruns its robot distorts the results.
"""

import threading
from typing import Callable, Optional

POLICIES = ("constant", "adaptive")
#: ROS time before a cancel from when the factor is 1, s.
CANCEL_AHEAD = 1.0
#: Distance to the point of interest from when the factor is 1, m.
ARRIVAL_AHEAD = 0.5
#: ROS time before the end of the question from when the factor is 1, s.
SPEECH_AHEAD = 0.7
#: ROS time after a dispatch in which the factor is 1, s.
REACTION = 1.0
#: Share of the factor asked for below which the machine does not keep up.
KEPT_UP = 0.9
#: By how much a lowered factor rises again with each second in which the machine keeps up.
RAISED = 1.1

#: Calls a function after some ROS time (s) in another thread; returns what prevents that.
CallAfter = Callable[[float, Callable[[], None]], Callable[[], None]]


class RealTimeFactor:
    """Sets the simulator's factor at the moments of a task; any thread may call it.

    :ivar lowest: the lowest factor that the machine forced upon the fast parts of the mission.
    """

    def __init__(
        self, policy: str, factor: float, set_factor: Callable[[float], bool], call_after: CallAfter
    ) -> None:
        """:param policy: one of POLICIES.
        :param factor: simulated seconds per second; 0: as fast as possible.
        :param set_factor: sets it in the simulator; returns whether the simulator took it. A refused factor
            is set again at the next moment that wants it.
        :param call_after: the timer.
        :raises ValueError: an unknown policy or a negative factor.
        """
        if policy not in POLICIES:
            raise ValueError(f"rtf_policy '{policy}' is not one of {', '.join(POLICIES)}")
        if not 0.0 <= factor < float("inf"):
            raise ValueError(f"a real-time factor of {factor} is not allowed; give 0 (fast) or more")
        self.lowest = factor
        self._adaptive = policy == "adaptive" and factor != 1.0
        self._factor = factor
        self._fast = factor  # what the machine keeps up with of it
        self._set_factor = set_factor
        self._call_after = call_after
        self._lock = threading.Lock()  # guards the fields below, and the order of calls to the simulator
        self._current = -1.0
        self._moment = 0  # counts what happened; a timer of an earlier moment changes nothing
        self._ending = False

    def mission_starts(self) -> bool:
        """Before the first task; whether the simulator took the factor."""
        with self._lock:
            return self._set(1.0 if self._adaptive else self._factor)

    def task_starts(self) -> None:
        """Before a goal is sent."""
        self._slow_down(ending=False)

    def action_starts(self, duration: float = 0.0) -> None:
        """An action was dispatched.

        :param duration: s of ROS time that it will take, if that is known; else 0.
        """
        if not self._adaptive:
            return
        with self._lock:
            if self._ending:
                return  # dispatched while the task is already being cancelled
            self._moment += 1
            moment = self._moment
            self._set(1.0)
        self._call_after(REACTION, lambda: self._change(moment, fast=True))
        if duration > REACTION + SPEECH_AHEAD:
            self._call_after(duration - SPEECH_AHEAD, lambda: self._change(moment, fast=False))

    def arrival_is_near(self) -> None:
        """A little before the robot arrives where it drives to."""
        self._slow_down()

    def cancel_is_near(self) -> None:
        """A little before a task is cancelled."""
        self._slow_down(ending=True)

    def reached(self, requested: float, achieved: float) -> None:
        """What the simulator says that the machine made of a factor, over about a second of wall time.

        :param requested: by the last call that set it, all that time.
        :param achieved: simulated seconds per second.
        """
        with self._lock:
            if not self._adaptive or self._factor == 0.0 or requested != self._current or requested == 1.0:
                return
            if achieved < KEPT_UP * requested:
                self._fast = max(1.0, achieved)
                self.lowest = min(self.lowest, self._fast)
            elif self._fast < self._factor:
                self._fast = min(self._factor, RAISED * self._fast)
            self._set(self._fast)

    def _slow_down(self, ending: Optional[bool] = None) -> None:
        if not self._adaptive:
            return
        with self._lock:
            self._moment += 1
            self._ending = self._ending if ending is None else ending
            self._set(1.0)

    def _change(self, moment: int, fast: bool) -> None:
        with self._lock:
            if moment == self._moment:
                self._set(self._fast if fast else 1.0)

    def _set(self, factor: float) -> bool:
        """With the lock held; whether the simulator has this factor now."""
        if factor != self._current and self._set_factor(factor):
            self._current = factor
        return factor == self._current
