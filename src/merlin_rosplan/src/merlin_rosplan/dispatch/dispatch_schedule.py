# SPDX-License-Identifier: Apache-2.0
"""What a plan allows to start next; here in the order of a list."""

import abc
from dataclasses import dataclass
from typing import AbstractSet, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple


class PlanError(ValueError):
    """A plan that cannot be dispatched; the text says why."""


class BindingError(ValueError):
    """Arguments that do not fit an operator; the text says how."""


@dataclass(frozen=True)
class PlannedAction:
    """A ground action of a plan.

    :param id: unique in its plan.
    :param name: PDDL operator.
    :param parameters: (label, object), in the order of the operator's parameters.
    :param duration, time: planned, s.
    """

    id: int
    name: str
    parameters: Tuple[Tuple[str, str], ...] = ()
    duration: float = 0.0
    time: float = 0.0

    def __str__(self) -> str:
        return "(" + " ".join((self.name,) + tuple(value for _, value in self.parameters)) + ")"


class Ongoing(NamedTuple):
    """The actions that run when a plan takes the place of another one."""

    kept: Sequence[PlannedAction] = ()
    """They go on: the plan counts on them, and does not contain them."""
    others: Sequence[PlannedAction] = ()
    """They go on where the plan begins with them."""
    used: AbstractSet[int] = frozenset()
    """Ids that the actions of the plan may not have."""
    new: AbstractSet[int] = frozenset()
    """Ids of those of the others with which the plan has to begin: it was made before they began."""


class Overtaken(NamedTuple):
    """An action that has ended before something that has to come first.

    :param action_id: the id of the action.
    :param text: one sentence.
    :param certain: False where the news of the other may only be late.
    """

    action_id: int
    text: str
    certain: bool


class Schedule(abc.ABC):
    """The state of one run of a plan. Times are seconds of ROS time; not thread-safe."""

    def __init__(self, actions: Iterable[PlannedAction]) -> None:
        self.actions: Dict[int, PlannedAction] = {}
        for action in actions:
            if action.id in self.actions:
                raise PlanError(f"two actions of the plan have the id {action.id}")
            self.actions[action.id] = action

    @property
    @abc.abstractmethod
    def finished(self) -> bool:
        """Whether every action has succeeded."""

    def happenings(self) -> List[Tuple[int, bool]]:
        """The start (False) and the end (True) of every action, by its id, in the order of the plan."""
        # Times of messages are float32: an end and a start of one moment may differ by some µs.
        timed = [(round(each.time, 3), True, each.id) for each in self.actions.values()]
        timed += [(round(each.time + each.duration, 3), False, each.id) for each in self.actions.values()]
        return [(action_id, not is_start) for _, is_start, action_id in sorted(timed)]

    def begin(self, now: float) -> None:  # noqa: B027 - nothing to do is a fine default
        """Called when the plan starts. ``now`` is ROS time, s."""

    @abc.abstractmethod
    def ready(self, now: float) -> List[PlannedAction]:
        """Actions that may start now and have not been started."""

    @abc.abstractmethod
    def started(self, action_id: int, now: float, seen: bool = True) -> None:
        """An action was dispatched; not `seen`: it is not known yet whether its start effects are applied."""

    def seen(self, action_id: int, now: float) -> None:  # noqa: B027 - most need not know
        """The start effects of an action are applied."""

    def awaited(self) -> List[int]:
        """Actions whose start effects are all that others wait for."""
        return []

    @abc.abstractmethod
    def ended(self, action_id: int, now: float) -> None:
        """An action has succeeded."""

    def wake_time(self, now: float) -> Optional[float]:
        """The next time after now at which something becomes ready or late by itself; None: never."""
        return None

    def waits_for_time(self, action_id: int) -> bool:
        """Whether an action had to wait for a time, as for one that a timed literal needs."""
        return False

    def late(self, now: float) -> Optional[str]:
        """Which time bound is broken, one sentence; None when none is."""
        return None

    def overtaken(self) -> List[Overtaken]:
        """Actions that ended before something that has to come first."""
        return []

    @abc.abstractmethod
    def waiting(self) -> List[str]:
        """Actions that have not been started, as text."""


class SequentialSchedule(Schedule):
    """One action after the other, in the order of the list; their times do not matter."""

    def __init__(self, actions: Iterable[PlannedAction]) -> None:
        ordered = list(actions)
        super().__init__(ordered)
        self._order = ordered
        self._next = 0
        self._running = False

    @property
    def finished(self) -> bool:
        """Whether every action has succeeded."""
        return self._next >= len(self._order) and not self._running

    def happenings(self) -> List[Tuple[int, bool]]:
        """Each action ends before the next one starts."""
        return [(action.id, at_end) for action in self._order for at_end in (False, True)]

    def ready(self, now: float) -> List[PlannedAction]:
        """The next action, when the one before it has ended."""
        return [] if self._running else self._order[self._next : self._next + 1]

    def started(self, action_id: int, now: float, seen: bool = True) -> None:
        """The next action was dispatched."""
        self._running = True
        self._next += 1

    def ended(self, action_id: int, now: float) -> None:
        """Notes that an action has succeeded."""
        self._running = False

    def waiting(self) -> List[str]:
        """The rest of the list."""
        return [str(action) for action in self._order[self._next :]]
