# SPDX-License-Identifier: Apache-2.0
"""What stress tests draw and measure in each cycle, and how they fail. Without a ROS node."""

import random
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

from merlin_msgs.msg import ExecuteGoal


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


class Deed(NamedTuple):
    """What is done to one of several requests."""

    do: str
    """``send``, ``cancel``, ``fact``: its goal is made true; ``kill``: the Executor dies."""
    request: int
    pause: float
    """s of ROS time before that."""


class JointCycle(NamedTuple):
    """Several requests that may run together; the same for the same seed."""

    requests: Sequence[Dict[str, Any]]
    """Of each its ``goals``, and how it is sent: parameters of :meth:`.MerlinExecutorClient.send`."""
    deeds: Sequence[Deed]


#: Parameter → its value, and how many of the requests have it.
_SOME_HAVE: Dict[str, Tuple[Any, float]] = {
    "priority": (1, 0.15),
    "on_interrupt": (ExecuteGoal.NEVER, 0.15),
    "alone": (True, 0.1),
    "survives": (True, 0.15),
}


def draw_joint(chance: random.Random, goals: Sequence[str], longest: float, kills: float = 0.0) -> JointCycle:
    """The next cycle with several requests.

    :param longest: s between two deeds at the most.
    :param kills: share of cycles in which the Executor dies.
    """
    drawn: List[Dict[str, Any]] = []
    deeds: List[Deed] = []

    def deed(do: str, request: int) -> None:
        deeds.append(Deed(do, request, chance.uniform(0.0, chance.choice((0.02, longest)))))

    count = chance.randint(2, 8)
    dies_behind = chance.randrange(count) if kills and chance.random() < kills else None
    for number in range(count):
        options: Dict[str, Any] = {"goals": chance.choice(list(goals))}
        if chance.random() < 0.4:
            options["deadline"] = chance.uniform(2.0, 300.0)
        if chance.random() < 0.1:
            options["not_before"] = chance.uniform(0.1, 1.0)
        options.update(
            {option: value for option, (value, share) in _SOME_HAVE.items() if chance.random() < share}
        )
        drawn.append(options)
        deed("send", number)
        if chance.random() < 0.35:
            deed("cancel", chance.randint(0, number))
        if chance.random() < 0.2:
            deed("fact", chance.randint(0, number))
        if number == dies_behind:
            deed("kill", number)
    if chance.random() < 0.5:
        for number in chance.sample(range(len(drawn)), len(drawn)):
            deed("cancel", number)
    return JointCycle(drawn, deeds)


def untrue(
    outcome: str,
    reason: str,
    options: Dict[str, Any],
    cancelled: bool,
    facts: Sequence[str],
    killed: bool = False,
) -> Optional[str]:
    """What is wrong with the end of a request, as a sentence; None: nothing is.

    :param options: how it was sent.
    :param cancelled: whether its client has cancelled it.
    :param facts: that hold since it has ended.
    :param killed: whether the Executor has died meanwhile.
    """
    if outcome in ("SUCCEEDED", "ALREADY_TRUE"):
        return None if options["goals"] in facts else f"{outcome}, and {options['goals']} does not hold"
    may_be = {"ACTION_FAILED": True, "CANCELLED": cancelled}
    may_be["INTERNAL"] = killed and not (options.get("survives") and not cancelled)
    may_be.update(dict.fromkeys(("LATE", "REFUSED"), "deadline" in options))
    return None if may_be.get(outcome) else f"{options} ended as {outcome}: {reason}"


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
