"""Which goals have the state machines of an operator: events in, decisions out.

A machine has one set of states, so it runs one goal at a time. Where no machine is free, a newer goal means
that the oldest one is no longer wanted. A run that does not stop in time is abandoned, with its machine:
another instance takes its place, so that "runs already" is not a lasting state.
"""

from enum import Enum
from typing import Dict, List, NamedTuple, Optional


class SlotStep(Enum):
    """What to do with a goal."""

    START = "start"
    PREEMPT = "preempt"
    """Call `limit_passed` when the goal has not stopped in time."""
    ABANDON = "abandon"
    """Answer it, replace the machine."""
    RECALL = "recall"
    """The execution never began."""


class SlotDecision(NamedTuple):
    """What to do with one goal, and why."""

    what: SlotStep
    goal: str
    reason: str = ""


class MachineSlot:
    """The goals of the machines of one operator. Not thread-safe.

    :param machines: how many there are.
    """

    def __init__(self, machines: int = 1) -> None:
        self._machines = machines
        self._running: Dict[str, bool] = {}  # goal -> whether its stop was requested, the oldest first
        self._waiting: Optional[str] = None

    @property
    def running(self) -> List[str]:
        """The goals that run, the oldest first."""
        return list(self._running)

    def resize(self, machines: int) -> List[SlotDecision]:
        """Sets the number of machines; running ones continue."""
        self._machines = machines
        return self._next()

    def arrive(self, goal: str) -> List[SlotDecision]:
        """A goal is received."""
        if self._free:
            return self._start(goal)
        replaced, self._waiting = self._waiting, goal
        decisions = []
        if replaced is not None:
            decisions.append(SlotDecision(SlotStep.RECALL, replaced, "a newer goal took its place"))
        if True in self._running.values():
            return decisions  # one that stops makes room
        return decisions + self._preempt(self.running[0], "a newer goal takes its place")

    def cancel(self, goal: str, reason: str) -> List[SlotDecision]:
        """A goal has to stop."""
        if goal == self._waiting:
            self._waiting = None
            return [SlotDecision(SlotStep.RECALL, goal, reason)]
        return self._preempt(goal, reason)

    def cancel_all(self, reason: str) -> List[SlotDecision]:
        """All have to stop, also the one that waits: it would begin when the others have."""
        waiting = [self._waiting] if self._waiting is not None else []
        return [decision for goal in [*waiting, *self.running] for decision in self.cancel(goal, reason)]

    def end(self, goal: str) -> List[SlotDecision]:
        """The run of a goal has ended."""
        return [] if self._running.pop(goal, None) is None else self._next()

    def limit_passed(self, goal: str) -> List[SlotDecision]:
        """A preempted run has not ended in time."""
        if not self._running.get(goal, False):
            return []
        del self._running[goal]
        return [SlotDecision(SlotStep.ABANDON, goal), *self._next()]

    @property
    def _free(self) -> bool:
        return len(self._running) < self._machines

    def _start(self, goal: str) -> List[SlotDecision]:
        self._running[goal] = False
        return [SlotDecision(SlotStep.START, goal)]

    def _next(self) -> List[SlotDecision]:
        if self._waiting is None or not self._free:
            return []
        following, self._waiting = self._waiting, None
        return self._start(following)

    def _preempt(self, goal: str, reason: str) -> List[SlotDecision]:
        if self._running.get(goal, True):
            return []
        self._running[goal] = True
        return [SlotDecision(SlotStep.PREEMPT, goal, reason)]
