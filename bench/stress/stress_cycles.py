# SPDX-License-Identifier: Apache-2.0
"""What stress tests draw and measure in each cycle, and how they fail. Without ROS."""

import random
from typing import Dict, List, NamedTuple, Optional, Sequence


class CycleTimes(NamedTuple):
    """Latencies of one cycle, ms; None where the cycle had nothing of the kind."""

    stop: Optional[float]
    """Cancel → first zero velocity command; only when the robot was driving."""
    idle: Optional[float]
    """Cancel → the Executor is ready for the next goal; None when it was so before."""
    dispatch: Optional[float]
    """Goal sent → its first action dispatched; None when it was cancelled before."""
    urgent: Optional[float]
    """Urgent request → its first action dispatched."""
    stage: str
    """Stage of the Executor at the moment of the cancel."""


class Violation(AssertionError):
    """Something that must not happen has happened; the text says what and in which cycle."""


class Cycle(NamedTuple):
    """What was done in one cycle; the same for the same seed."""

    goals: Sequence[str]
    pauses: Sequence[float]
    """s of wall time before the robot leaves, and before the cancel."""
    victim: str
    """Robot that leaves; empty: none does."""
    how: str
    """``kill``, ``stop`` (its host hangs) or ``out`` (its operator takes it out)."""
    cancel: bool


def draw(chance: random.Random, robots: Sequence[str], places: Sequence[str], longest: float) -> Cycle:
    """The next cycle.

    :param longest: s between two events at the most.
    """
    goals = chance.sample(list(places), chance.randint(1, min(3, len(places))))
    pauses = [chance.uniform(0.0, chance.choice((0.1, longest))) for _ in range(2)]
    how = chance.choice(("kill", "stop", "out", "out", "", "", "", ""))
    return Cycle(goals, pauses, chance.choice(list(robots)) if how else "", how, chance.random() < 0.9)


def arguments_of(facts: Sequence[str]) -> List[str]:
    """The first argument of each fact, as PDDL text."""
    return [fact.strip("()").split()[1] for fact in facts]


def places_of(facts: Sequence[str]) -> Dict[str, List[str]]:
    """Robot → the places that facts ``(robot_at robot place)`` name; a consistent state has one each."""
    places: Dict[str, List[str]] = {}
    for fact in facts:
        _, robot, place = fact.strip("()").split()
        places.setdefault(robot, []).append(place)
    return places


def twice(names: Sequence[str]) -> List[str]:
    """The names that occur more than once, sorted."""
    return sorted({name for name in names if names.count(name) > 1})
