"""Which executions of one operator run, wait, and have to stop: events in, decisions out."""

from enum import Enum
from typing import Dict, List, NamedTuple, Tuple, Union

#: Plan id and action id.
Key = Tuple[int, int]
#: Executions that wait at most.
WAITING = 1000


class QueueStep(Enum):
    """What to do with an execution."""

    RUN = "run"
    WAIT = "wait"
    """Report to the queue when the execution has waited too long."""
    INTERRUPT = "interrupt"
    REFUSE = "refuse"
    """The execution ends without having begun."""


class QueueDecision(NamedTuple):
    """What to do with one execution, and why."""

    what: QueueStep
    key: Key
    reason: str = ""


def at_once(concurrent: Union[bool, int]) -> int:
    """How many executions may run at once; 0: any number.

    :param concurrent: a number, or whether they may.
    """
    if concurrent is True:
        return 0
    return max(1, int(concurrent))


class _Waiting(NamedTuple):
    key: Key
    lane: str


class _Run:
    def __init__(self, lane: str) -> None:
        self.lane = lane
        self.interrupted = False


class ExecutionQueue:
    """The executions of an operator. Not thread-safe.

    Each runs in a lane: those of different lanes do not wait for each other. In a full lane the next one
    waits for an end: "runs already" is not a lasting state. One of an older plan is interrupted then, because
    the dispatcher that wanted it has gone on.

    :param limit: how many executions of one lane run at once; 0: any number.
    """

    def __init__(self, limit: int = 1) -> None:
        self._limit = limit
        self._running: Dict[Key, _Run] = {}
        self._waiting: List[_Waiting] = []

    @property
    def idle(self) -> bool:
        """Whether nothing runs or waits."""
        return not self._running and not self._waiting

    def allow(self, limit: int) -> List[QueueDecision]:
        """Sets how many executions of one lane run at once; running ones continue."""
        self._limit = limit
        return self._promote()

    def arrive(self, key: Key, lane: str = "") -> List[QueueDecision]:
        """An execution is dispatched. None for one that is already in the queue: it runs once."""
        if key in self._running or key in [waiting.key for waiting in self._waiting]:
            return []
        if self._free(lane) and all(waiting.lane != lane for waiting in self._waiting):
            return [self._run(key, lane)]
        if len(self._waiting) >= WAITING:
            return [QueueDecision(QueueStep.REFUSE, key, f"{WAITING} wait already; no more may")]
        self._waiting.append(_Waiting(key, lane))
        decisions = [QueueDecision(QueueStep.WAIT, key)]
        for other, run in self._running.items():
            if run.lane == lane and other[0] != key[0]:
                decisions += self._interrupt(other, f"plan {key[0]} has taken the place of plan {other[0]}")
        return decisions

    def cancel(self, key: Key, reason: str) -> List[QueueDecision]:
        """An execution has to stop."""
        if self._leave(key):
            return [QueueDecision(QueueStep.REFUSE, key, reason)]
        return self._interrupt(key, reason)

    def cancel_all(self, reason: str) -> List[QueueDecision]:
        """All have to stop."""
        keys = [*(waiting.key for waiting in self._waiting), *self._running]
        return [decision for key in keys for decision in self.cancel(key, reason)]

    def waited_too_long(self, key: Key) -> List[QueueDecision]:
        """The limit for a waiting execution has passed."""
        if not self._leave(key):
            return []
        return [
            QueueDecision(QueueStep.REFUSE, key, "it runs already, and the execution before it does not end")
        ]

    def end(self, key: Key) -> List[QueueDecision]:
        """A running execution has ended."""
        self._running.pop(key, None)
        return self._promote()

    def _free(self, lane: str) -> bool:
        return not self._limit or sum(run.lane == lane for run in self._running.values()) < self._limit

    def _run(self, key: Key, lane: str) -> QueueDecision:
        self._running[key] = _Run(lane)
        return QueueDecision(QueueStep.RUN, key)

    def _promote(self) -> List[QueueDecision]:
        """Runs what has waited, the oldest of a lane first."""
        decisions = []
        for waiting in list(self._waiting):
            if self._free(waiting.lane):
                self._waiting.remove(waiting)
                decisions.append(self._run(*waiting))
        return decisions

    def _leave(self, key: Key) -> bool:
        """Whether an execution has waited; it waits no more."""
        left = [waiting for waiting in self._waiting if waiting.key != key]
        waited = len(left) < len(self._waiting)
        self._waiting = left
        return waited

    def _interrupt(self, key: Key, reason: str) -> List[QueueDecision]:
        run = self._running.get(key)
        if run is None or run.interrupted:
            return []
        run.interrupted = True
        return [QueueDecision(QueueStep.INTERRUPT, key, reason)]
