# SPDX-License-Identifier: Apache-2.0
"""Which work runs, which waits, and which has to stop: events in, decisions out.

The book of every server that runs something for a client: plans of a dispatcher, executions of an operator,
goals of a state machine, goals of a serial action server. What differs between them is a :class:`Policy`.
Pure and not thread-safe: the owner's lock is held around each call, and decisions are carried out without it.
"""

from enum import Enum
from typing import Any, Dict, Generic, Hashable, List, NamedTuple, Optional, Set, TypeVar

#: Work that waits in turn at most.
WAITING = 1000
TAKEN = "a newer goal took its place"
STUCK = "it runs already, and the execution before it does not end"

K = TypeVar("K", bound=Hashable)


class Policy(Enum):
    """What becomes of work that finds its lane full."""

    IN_TURN = "in turn"
    """It waits for its turn. What a lane runs of an older batch is stopped: its client has gone on."""
    NEWEST = "newest"
    """It takes the place of what waits, and the oldest that runs is stopped."""


class Step(Enum):
    """What to do with a piece of work."""

    RUN = "run"
    WAIT = "wait"
    """Where a wait for an end has a limit: call :meth:`WorkBook.overdue` when it has passed."""
    STOP = "stop"
    """Likewise where a stop has one."""
    REFUSE = "refuse"
    """It ends without having begun."""
    ABANDON = "abandon"
    """It did not stop in time, and no longer keeps others from running."""


class Decision(NamedTuple):
    """What to do with one piece of work, and why."""

    what: Step
    key: Any
    reason: str = ""


class _Work(Generic[K]):
    def __init__(self, key: K, lane: str, batch: int) -> None:
        self.key, self.lane, self.batch = key, lane, batch
        self.stops = False
        self.behind: Set[K] = set()  # what has run in the lane since its wait, or the limit of that, began


class WorkBook(Generic[K]):
    """The work of one server. Each piece that arrives ends once: by `end`, REFUSE or ABANDON.

    Each runs in a lane, and those of different lanes do not wait for each other. That the lane is full is
    never a lasting state: what is in the way is stopped, or what waits is refused when it is overdue.

    :param policy: for a full lane.
    :param room: how many run at once in a lane; 0: any number.
    :param asked: nothing runs before :meth:`begin`; for an owner whose worker takes one after the other.
    """

    def __init__(self, policy: Policy, room: int = 1, asked: bool = False) -> None:
        self._policy = policy
        self._room = room
        self._asked = asked
        self._running: Dict[K, _Work[K]] = {}  # the oldest first
        self._waiting: Dict[K, _Work[K]] = {}  # likewise

    @property
    def running(self) -> List[K]:
        """What runs, the oldest first."""
        return list(self._running)

    @property
    def idle(self) -> bool:
        """Whether nothing runs or waits."""
        return not self._running and not self._waiting

    def allow(self, room: int) -> List[Decision]:
        """Sets how many run at once in a lane; what runs continues unless a newer one waits for its place."""
        self._room = room
        decisions = self._promote()
        if self._policy is Policy.NEWEST:
            for lane in dict.fromkeys(work.lane for work in self._waiting.values()):
                decisions += self._make_room(lane)
        return decisions

    def arrive(self, key: K, lane: str = "", batch: int = 0) -> List[Decision]:
        """Work has come; none for a key that is in the book already: it runs once.

        :param batch: what belongs together, as the actions of a plan.
        """
        if key in self._running or key in self._waiting:
            return []
        before = [each for each in self._waiting.values() if each.lane == lane]
        work = self._waiting[key] = _Work(key, lane, batch)
        if not before and self._free(lane):
            return self._promote()
        if self._policy is Policy.NEWEST:
            return self._replace(before, lane)
        if len(self._waiting) > WAITING:
            del self._waiting[key]
            return [Decision(Step.REFUSE, key, f"{WAITING} wait already; no more may")]
        work.behind = self._running_in(lane)
        decisions = [Decision(Step.WAIT, key)]
        for other in self._running.values():
            if other.lane == lane and other.batch != batch:
                decisions += self._stop(other, f"plan {batch} has taken the place of plan {other.batch}")
        return decisions

    def begin(self) -> Optional[K]:
        """The next that runs from now on; None when none may. Where the owner asks for it."""
        key = next((key for key, work in self._waiting.items() if self._free(work.lane)), None)
        if key is not None:
            self._running[key] = self._waiting.pop(key)
        return key

    def cancel(self, key: K, reason: str) -> List[Decision]:
        """Work has to stop."""
        if self._waiting.pop(key, None) is not None:
            return [Decision(Step.REFUSE, key, reason)]
        return self._stop(self._running[key], reason) if key in self._running else []

    def cancel_all(self, reason: str) -> List[Decision]:
        """All has to stop; what waits first, which would begin when the rest has ended."""
        keys = [*self._waiting, *self._running]
        return [decision for key in keys for decision in self.cancel(key, reason)]

    def overdue(self, key: K) -> List[Decision]:
        """The limit for what waits, or for what has to stop, has passed.

        What waits goes on waiting where something that was in the way has ended: others wait before it.
        """
        work = self._waiting.get(key)
        if work is not None:
            before, work.behind = work.behind, self._running_in(work.lane)
            if not before <= work.behind:
                return [Decision(Step.WAIT, key)]
            del self._waiting[key]
            return [Decision(Step.REFUSE, key, STUCK)]
        if key not in self._running or not self._running[key].stops:
            return []
        return [Decision(Step.ABANDON, key), *self.end(key)]

    def end(self, key: K) -> List[Decision]:
        """What runs has ended."""
        return [] if self._running.pop(key, None) is None else self._promote()

    def _running_in(self, lane: str) -> Set[K]:
        return {work.key for work in self._running.values() if work.lane == lane}

    def _free(self, lane: str) -> bool:
        return not self._room or len(self._running_in(lane)) < self._room

    def _promote(self) -> List[Decision]:
        """Runs what has waited, the oldest of a lane first."""
        decisions: List[Decision] = []
        while not self._asked:
            key = self.begin()
            if key is None:
                break
            decisions.append(Decision(Step.RUN, key))
        return decisions

    def _replace(self, before: List[_Work[K]], lane: str) -> List[Decision]:
        for work in before:
            del self._waiting[work.key]
        decisions = [Decision(Step.REFUSE, work.key, TAKEN) for work in before]
        return decisions + self._make_room(lane)

    def _make_room(self, lane: str) -> List[Decision]:
        """Stops as many, the oldest first, as are in the way of one that waits."""
        running = [work for work in self._running.values() if work.lane == lane and not work.stops]
        surplus = len(running) - self._room + 1 if self._room else 0  # what stops makes room
        stopped = [self._stop(work, "a newer goal takes its place") for work in running[: max(0, surplus)]]
        return [decision for decisions in stopped for decision in decisions]

    @staticmethod
    def _stop(work: _Work[K], reason: str) -> List[Decision]:
        if work.stops:
            return []
        work.stops = True
        return [Decision(Step.STOP, work.key, reason)]
