"""Which goal has the state machine of an operator: events in, decisions out.

A machine has one set of states, so it runs one goal at a time. A newer goal means that the older one is not
wanted any more. A run that does not stop in time is abandoned, with its machine: another instance takes its
place, so that "runs already" is not a lasting state.
"""

from enum import Enum
from typing import List, NamedTuple, Optional


class SlotStep(Enum):
    """What to do with a goal."""

    START = "start"
    PREEMPT = "preempt"
    """Call `limit_passed` when the goal has not stopped in time."""
    ABANDON = "abandon"
    """Answer it, replace the machine."""
    RECALL = "recall"
    """It never began."""


class SlotDecision(NamedTuple):
    """What to do with one goal, and why."""

    what: SlotStep
    goal: str
    reason: str = ""


class MachineSlot:
    """The goals of one machine. Not thread-safe."""

    def __init__(self) -> None:
        self.running: Optional[str] = None
        self._waiting: Optional[str] = None
        self._stopping = False

    def arrive(self, goal: str) -> List[SlotDecision]:
        """A goal is received."""
        if self.running is None:
            return self._start(goal)
        replaced, self._waiting = self._waiting, goal
        decisions = []
        if replaced is not None:
            decisions.append(SlotDecision(SlotStep.RECALL, replaced, "a newer goal took its place"))
        return decisions + self._preempt("a newer goal takes its place")

    def cancel(self, goal: str, reason: str) -> List[SlotDecision]:
        """A goal has to stop."""
        if goal == self._waiting:
            self._waiting = None
            return [SlotDecision(SlotStep.RECALL, goal, reason)]
        return self._preempt(reason) if goal == self.running else []

    def end(self, goal: str) -> List[SlotDecision]:
        """The run of a goal has ended."""
        return self._next() if goal == self.running else []

    def limit_passed(self, goal: str) -> List[SlotDecision]:
        """A preempted run has not ended in time."""
        if goal != self.running or not self._stopping:
            return []
        return [SlotDecision(SlotStep.ABANDON, goal), *self._next()]

    def _start(self, goal: str) -> List[SlotDecision]:
        self.running, self._stopping = goal, False
        return [SlotDecision(SlotStep.START, goal)]

    def _next(self) -> List[SlotDecision]:
        self.running = None
        following, self._waiting = self._waiting, None
        return [] if following is None else self._start(following)

    def _preempt(self, reason: str) -> List[SlotDecision]:
        if self.running is None or self._stopping:
            return []
        self._stopping = True
        return [SlotDecision(SlotStep.PREEMPT, self.running, reason)]
