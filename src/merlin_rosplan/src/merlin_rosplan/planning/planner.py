# SPDX-License-Identifier: Apache-2.0
"""What all engines have in common: a task in, an attempt out, and a stop that any thread may call."""

from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import Any, Iterable, List, Protocol, Tuple

from merlin_pddl.plan_text import PlanStep

#: In place of a time.
NOT_KNOWN = -1.0


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


class PlannerState(IntEnum):
    """State of a planner; the numbers are those of merlin_msgs/PlannerStatus."""

    IDLE = 0
    RUNNING = 1
    SOLVED = 2
    UNSOLVABLE = 3  # proven: no plan exists
    TIMEOUT = 4
    CRASHED = 5  # could not start, ended abnormally, ran out of memory, or said nothing
    INVALID = 6  # the domain or the problem is not valid PDDL, or the plan did not validate
    CANCELLED = 7
    NO_PLAN = 8  # the planner gave up without a plan and without a proof that there is none


@dataclass(frozen=True)
class PlanningOutcome:
    """The end of one planning.

    :param state: how it ended.
    :param reason: one sentence; for SOLVED the size of the plan.
    :param plan: text in POPF's form, empty unless SOLVED (and when the empty plan solves the problem).
    :param planner: which program planned.
    :param seconds: of wall time.
    :param reached: s from the begin of the plan at which each goal with a deadline is reached; where it is
        proven that they cannot all be in time, by a plan without the deadlines, or NOT_KNOWN; empty: no plan.
    """

    state: PlannerState
    reason: str
    plan: str = ""
    planner: str = ""
    seconds: float = 0.0
    reached: Tuple[float, ...] = ()

    @property
    def solved(self) -> bool:
        """Whether there is a plan."""
        return self.state == PlannerState.SOLVED


@dataclass(frozen=True)
class Task:
    """What an engine is to solve.

    :param domain_path, problem_path: absolute paths of the PDDL files.
    :param domain, problem: their text.
    :param folder: where it may write; other engines have other ones.
    :param settings: limits; the command is already the engine's own.
    """

    domain_path: Path
    problem_path: Path
    domain: str
    problem: str
    folder: Path
    settings: PlannerSettings


@dataclass(frozen=True)
class Attempt:
    """How an engine ended.

    :param planner: name of the engine.
    :param state: SOLVED with candidate plans, else why there is no plan.
    :param reason: one sentence; empty when SOLVED.
    :param plans: the one to prefer first. They may be cut off or wrong: the first that validates counts.
    """

    planner: str
    state: PlannerState
    reason: str
    plans: List[List[PlanStep]] = field(default_factory=list)


class Planner(Protocol):
    """Finds plans for a task; one class for each engine."""

    name: str

    def begin(self, task: Task) -> None:
        """Starts what works beside this process, if anything does; :meth:`plan` follows.

        :raises OSError: the engine cannot be started.
        """

    def plan(self, task: Task) -> Attempt:
        """Plans to the end or to the limit of the task; used once.

        :raises OSError: the engine cannot be started.
        """

    def stop(self) -> None:
        """Makes :meth:`plan` return soon, with the plans found so far; from any thread, at any moment."""
