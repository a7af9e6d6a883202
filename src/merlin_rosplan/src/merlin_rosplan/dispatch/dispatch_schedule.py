# SPDX-License-Identifier: Apache-2.0
"""The actions of a plan, and what is wrong with one."""

from dataclasses import dataclass
from typing import AbstractSet, NamedTuple, Sequence, Tuple


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
