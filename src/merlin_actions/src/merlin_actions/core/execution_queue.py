"""Which executions of one operator run, wait, and have to stop: events in, decisions out."""

from enum import Enum
from typing import Dict, List, NamedTuple, Tuple

Key = Tuple[int, int]
"""Plan id and action id."""


class QueueStep(Enum):
    """What to do with an execution."""

    RUN = "run"
    WAIT = "wait"
    """Report to the queue when the execution has waited too long."""
    INTERRUPT = "interrupt"
    REFUSE = "refuse"
    """It ends without having begun."""


class QueueDecision(NamedTuple):
    """What to do with one execution, and why."""

    what: QueueStep
    key: Key
    reason: str = ""


class ExecutionQueue:
    """The executions of an operator. Not thread-safe.

    A second one waits for the end of the first: "runs already" is not a lasting state. One of an older plan
    is interrupted, because the dispatcher that wanted it has gone on.

    :param concurrent: whether the operator may run several times at once.
    """

    def __init__(self, concurrent: bool) -> None:
        self._concurrent = concurrent
        self._running: Dict[Key, bool] = {}  # -> whether it was interrupted
        self._waiting: List[Key] = []

    @property
    def idle(self) -> bool:
        """Whether nothing runs or waits."""
        return not self._running and not self._waiting

    def arrive(self, key: Key) -> List[QueueDecision]:
        """An execution is dispatched. None when it is there already: it runs once."""
        if key in self._running or key in self._waiting:
            return []
        if self._concurrent or self.idle:
            self._running[key] = False
            return [QueueDecision(QueueStep.RUN, key)]
        self._waiting.append(key)
        decisions = [QueueDecision(QueueStep.WAIT, key)]
        for other in self._running:
            if other[0] != key[0]:
                decisions += self._interrupt(other, f"plan {key[0]} has taken the place of plan {other[0]}")
        return decisions

    def cancel(self, key: Key, reason: str) -> List[QueueDecision]:
        """An execution has to stop."""
        if key in self._waiting:
            self._waiting.remove(key)
            return [QueueDecision(QueueStep.REFUSE, key, reason)]
        return self._interrupt(key, reason)

    def cancel_all(self, reason: str) -> List[QueueDecision]:
        """All have to stop."""
        return [decision for key in [*self._waiting, *self._running] for decision in self.cancel(key, reason)]

    def waited_too_long(self, key: Key) -> List[QueueDecision]:
        """The limit for a waiting execution has passed."""
        if key not in self._waiting:
            return []
        self._waiting.remove(key)
        return [
            QueueDecision(QueueStep.REFUSE, key, "it runs already, and the execution before it does not end")
        ]

    def end(self, key: Key) -> List[QueueDecision]:
        """A running execution has ended."""
        self._running.pop(key, None)
        if self._running or not self._waiting:
            return []
        following = self._waiting.pop(0)
        self._running[following] = False
        return [QueueDecision(QueueStep.RUN, following)]

    def _interrupt(self, key: Key, reason: str) -> List[QueueDecision]:
        if self._running.get(key, True):
            return []
        self._running[key] = True
        return [QueueDecision(QueueStep.INTERRUPT, key, reason)]
