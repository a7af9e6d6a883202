# SPDX-License-Identifier: Apache-2.0
"""What all engines have in common: a task in, an attempt out, and a stop that any thread may call."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import List, Protocol

from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.planning.planner_settings import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState


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
