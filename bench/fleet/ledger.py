# SPDX-License-Identifier: Apache-2.0
"""Which robot executes which goal, as seen beside the fleet; and what of it must not be."""

import threading
from typing import Dict, Iterable, List, NamedTuple, Optional, Set, Tuple

DONE = "SUCCEEDED"
GRACE = 2.0  # s in which a robot that hung has to stop what it must no longer execute


class Ended(NamedTuple):
    """An execution that is over."""

    goal: str
    robot: str
    begun: float
    ended: float
    outcome: str
    """Empty: its robot was killed."""


class Ledger:
    """Takes what each robot begins and ends. Thread-safe. Times are s of one clock of the machine."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the fields below
        self._running: Dict[Tuple[str, str], float] = {}
        self._hung: Dict[Tuple[str, str], Tuple[float, float]] = {}  # begin, and when it went on
        self._hanging: Set[str] = set()
        self._over: List[Ended] = []
        self._overlaps: List[str] = []

    def begin(self, robot: str, goal: str, at: float) -> None:
        """A robot executes a goal from now on; a hanging one had begun before, and its report came late."""
        with self._lock:
            if robot in self._hanging:
                self._hung[(robot, goal)] = (at, float("inf"))
                return
            for other, running in self._running:
                if running == goal and other != robot:
                    self._overlaps.append(f"{goal} was executed by {other} and {robot} at once")
            self._running[(robot, goal)] = at

    def end(self, robot: str, goal: str, at: float, outcome: str) -> None:
        """Nothing of it moves any more."""
        with self._lock:
            begun, resumed = self._hung.pop((robot, goal), (at, at))
            begun = self._running.pop((robot, goal), begun)
            if at > resumed + GRACE and self._beside(robot, goal, resumed + GRACE, at):
                self._overlaps.append(f"{goal} was executed by {robot}, which hung, and another one at once")
            self._over.append(Ended(goal, robot, begun, at, outcome))

    def hang(self, robot: str) -> None:
        """Nothing of a robot runs until :meth:`resume`."""
        with self._lock:
            self._hanging.add(robot)
            for name, goal in [each for each in self._running if each[0] == robot]:
                self._hung[(name, goal)] = (self._running.pop((name, goal)), float("inf"))

    def resume(self, robot: str, at: float) -> None:
        """It continues, and has `GRACE` to stop what another one executes."""
        with self._lock:
            self._hanging.discard(robot)
            for key, (begun, _) in list(self._hung.items()):
                if key[0] == robot:
                    self._hung[key] = (begun, at)

    def kill(self, robot: str, at: float) -> None:
        """A robot is dead, and with it all that it executed."""
        for goal in self.running(robot):
            self.end(robot, goal, at, "")

    def running(self, robot: str) -> Set[str]:
        """What a robot executes."""
        with self._lock:
            return {goal for name, goal in (*self._running, *self._hung) if name == robot}

    def next_begun(self, goal: str, after: float) -> Optional[str]:
        """The robot that began a goal after a moment; None: none has."""
        with self._lock:
            begun = [(at, robot) for (robot, running), at in self._running.items() if running == goal]
            begun += [(it.begun, it.robot) for it in self._over if it.goal == goal]
        later = sorted(each for each in begun if each[0] > after)
        return later[0][1] if later else None

    def times_done(self, goal: str) -> int:
        """How often it was done."""
        with self._lock:
            return sum(it.goal == goal and it.outcome == DONE for it in self._over)

    @property
    def overlaps(self) -> List[str]:
        """Goals that two robots executed at once, in words."""
        with self._lock:
            return list(self._overlaps)

    def _beside(self, robot: str, goal: str, since: float, until: float) -> bool:
        """Whether another robot has executed a goal in an interval. Called with the lock held."""
        others = [(at, until) for (name, what), at in self._running.items() if what == goal and name != robot]
        others += [(it.begun, it.ended) for it in self._over if it.goal == goal and it.robot != robot]
        return any(begun < until and ended > since for begun, ended in others)

    def mistakes(self, goals: Iterable[str], ends: Dict[str, str]) -> List[str]:
        """What must not be when all is over.

        :param goals: that were sent.
        :param ends: how the fleet says they ended; those that have not are missing.
        """
        with self._lock:
            found = list(self._overlaps)
            done = [it.goal for it in self._over if it.outcome == DONE]
            still = sorted(f"{robot} still executes {goal}" for robot, goal in self._running)
        for goal in goals:
            if goal not in ends:
                found.append(f"{goal} was lost: it has not ended")
            elif ends[goal] == DONE and goal not in done:
                found.append(f"{goal} was reported as done, and no robot did it")
            if done.count(goal) > 1:
                found.append(f"{goal} was done {done.count(goal)} times")
        return found + still
