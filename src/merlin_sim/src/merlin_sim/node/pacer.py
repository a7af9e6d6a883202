# SPDX-License-Identifier: Apache-2.0
"""Keeps simulated time in step with wall time, at a factor that can change, with pauses."""

import math
import threading
import time
from typing import Optional

MAX_LAG = 0.1  # s of wall time behind schedule that is made up for; more is given up
LONGEST = 3600.0  # s of one wait; Python can wait for no more than 292 years


class Pacer:
    """Paces one simulation loop.

    :param factor: simulated seconds per second of wall time; 0: as fast as possible.
    """

    def __init__(self, factor: float) -> None:
        self._changed = threading.Condition()  # guards the fields below
        self.factor = factor
        """The factor asked for."""
        self._paused = False  # whether a pause was asked for
        self._stepping = False  # whether a step that was due is under way
        self._stopped = False
        self._due: Optional[float] = None  # monotonic time at which the next step is due
        self._measured_from = (time.monotonic(), 0.0)
        self._simulated = 0.0

    @property
    def paused(self) -> bool:
        """Whether time stands still: the step under way when a pause was asked for has ended."""
        return self._paused and not self._stepping

    def set_factor(self, factor: float) -> None:
        """Changes the factor from the next step on."""
        with self._changed:
            self.factor = factor
            self._due = None
            self._changed.notify_all()

    def set_paused(self, paused: bool) -> None:
        """Pauses time, or lets it run. A pause waits for the step under way; the loop must not call this."""
        with self._changed:
            self._paused = paused
            self._due = None
            self._changed.notify_all()
            self._changed.wait_for(lambda: not (self._paused and self._stepping) or self._stopped)

    def stop(self) -> None:
        """Ends every wait, now and later."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def wait(self, step: float, limit: float = math.inf) -> bool:
        """Waits until the next step of `step` simulated seconds is due; False when it was stopped.

        After True the caller carries the step out and calls :meth:`step_ended`.

        :param limit: factor that this step must not exceed.
        """
        with self._changed:
            while not self._stopped:
                if self._paused:
                    self._changed.wait()
                    continue
                now = time.monotonic()
                pace = min(self.factor or math.inf, limit)
                if self._due is None or pace == math.inf or now - self._due > MAX_LAG:
                    self._due = now
                left = self._due - now
                if left <= 0.0:
                    if pace < math.inf:
                        self._due += step / pace
                    self._simulated += step
                    self._stepping = True
                    return True
                self._changed.wait(min(left, LONGEST))
            return False

    def step_ended(self) -> None:
        """The step that was due has been carried out."""
        with self._changed:
            self._stepping = False
            self._changed.notify_all()

    def achieved(self) -> float:
        """The factor really achieved since the last call."""
        with self._changed:
            now = time.monotonic()
            since, simulated = self._measured_from
            self._measured_from = (now, self._simulated)
            return (self._simulated - simulated) / (now - since) if now > since else 0.0
