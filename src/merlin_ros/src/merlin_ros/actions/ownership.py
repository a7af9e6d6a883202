# SPDX-License-Identifier: Apache-2.0
"""Served goals whose owner is silent: their state is passed on to the goals sent on their behalf.

A server suspends the goals of a silent client here; the leases that this process publishes say so at once
(:class:`.lease_holder.LeaseHolder`). Where it is known on behalf of which goal another one was sent,
only that one counts; else one suspended goal suspends all that the process has sent.
"""

import threading
from typing import Callable, List, Optional, Set

from merlin_ros.actions.hang_watch import HangWatch, hangs
from merlin_ros.master.master_link import silent


class Ownership:
    """The suspended goals of a process; thread-safe.

    :param watch: of the process.
    """

    def __init__(self, watch: HangWatch = hangs) -> None:
        self._watch = watch
        self._lock = threading.Lock()  # guards both fields below
        self._suspended: Set[str] = set()
        self._listeners: List[Callable[[], None]] = []

    def suspend(self, goal: str) -> None:
        """The owner of a goal is silent."""
        self._change(self._suspended.add, goal, True)

    def resume(self, goal: str) -> None:
        """The owner of a goal is back, or the goal has ended."""
        self._change(self._suspended.discard, goal, False)

    def _change(self, change: Callable[[str], None], goal: str, suspended: bool) -> None:
        with self._lock:
            if (goal in self._suspended) is suspended:
                return
            change(goal)
            listeners = list(self._listeners)
        for listener in listeners:
            listener()

    def suspended(self, goal: Optional[str] = None) -> bool:
        """Whether a goal is suspended; None: any of the process.

        All are while the master is silent, and while this process may not have read what came during a hang
        of it: a cancel, as a rule.
        """
        if silent.is_set() or self._watch.unsettled() > 0.0:
            return True
        with self._lock:
            return bool(self._suspended) if goal is None else goal in self._suspended

    def listen(self, callback: Callable[[], None]) -> None:
        """Calls back after each change, in the thread that makes it; must not block."""
        with self._lock:
            self._listeners.append(callback)

    def ignore(self, callback: Callable[[], None]) -> None:
        """Calls back no more."""
        with self._lock:
            if callback in self._listeners:
                self._listeners.remove(callback)


#: That of this process.
ownership = Ownership()
