# SPDX-License-Identifier: Apache-2.0
"""What may be set of a planning."""

from dataclasses import dataclass
from typing import Any, Iterable, Tuple


@dataclass(frozen=True)
class PlannerSettings:
    """How to plan.

    :param command: external planner with DOMAIN and PROBLEM, the name of an engine, two of them joined by
        ``+``; empty: kairos.
    :param fallback: use kairos when the command's program is missing.
    :param time_limit: running time for one planning, s; 0 means none. A ``timeout N`` in the command wins.
    :param anytime: s that an engine may continue looking for a better plan after the last one; 0 takes the
        first.
    :param check_input: check domain and problem before planning.
    :param memory_limit: MB for the planner and everything it starts, and of addresses for each; 0 means none.
    :param output_limit: MB that a planner may write into one file; 0 means none.
    :param without: actions to leave out, as PDDL text with ``*`` for any argument.
    :param dues: goals that have to be reached in time: PDDL texts, and s from the begin of the plan.
    """

    command: str = ""
    fallback: bool = True
    time_limit: float = 60.0
    anytime: float = 0.2
    check_input: bool = True
    memory_limit: float = 4096.0
    output_limit: float = 64.0
    without: Tuple[str, ...] = ()
    dues: Tuple[Tuple[Tuple[str, ...], float], ...] = ()


def dues_of(deadlines: Iterable[Any]) -> Tuple[Tuple[Tuple[str, ...], float], ...]:
    """The goals with deadlines of a request.

    :param deadlines: messages as merlin_msgs/GoalDeadline.
    """
    return tuple((tuple(deadline.goals), float(deadline.within)) for deadline in deadlines)
