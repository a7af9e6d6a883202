# SPDX-License-Identifier: Apache-2.0
"""Plans that are shown and not carried out, beside what the robot plans itself."""

import contextlib
import dataclasses
import threading
from pathlib import Path
from typing import Any, Callable, ContextManager, NamedTuple, Optional, Sequence, Tuple

from merlin_pddl.analysis.demand import demand
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.knowledge import conjuncts
from merlin_pddl.plan_text import NO_DURATION, PlanStep, parse_plan
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import parse_condition, parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_pddl.text_reader import PddlError, text_of
from merlin_rosplan.knowledge.foreseen import after_actions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.planning.planner_settings import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState, PlanningOutcome
from merlin_rosplan.supervision.planner_host import PlannerHosts
from merlin_rosplan.supervision.scratch_folder import ScratchFolder
from merlin_rosplan.supervision.supervised_planning import Planning

#: Longest time for a plan that is only looked at, s: its reader waits for it.
PREVIEW_LIMIT = 10.0
#: What :func:`write_later_problem` raises; each with a text that says it.
LATER_ERRORS = (PddlError, UpdateRefused, OSError)
BUSY = "another plan is being looked for, only to be shown; ask again when it is there"


Watch = Callable[[Callable[[], None]], ContextManager[Any]]


class Wanted(NamedTuple):
    """What a plan is to reach, as PDDL text.

    :ivar without: actions that it must not have, see :class:`PlannerSettings`.
    :ivar include: actions that it has to have.
    """

    goals: Sequence[str]
    without: Sequence[str] = ()
    include: Sequence[str] = ()


class Previews:
    """Plans goals one after the other; a second one at the same time is refused. Thread-safe.

    :param limit: the longest one, s.
    :param niceness: nice value of what plans.
    :param while_wanted: within it, a function is called when the caller of :meth:`plan` has gone.
    """

    def __init__(
        self, limit: float = PREVIEW_LIMIT, niceness: int = 0, while_wanted: Watch = contextlib.nullcontext
    ) -> None:
        self._limit, self._while_wanted = limit, while_wanted
        self._folder = ScratchFolder("plan_preview")
        # Of its own: a process never gets its priority back.
        self._hosts = PlannerHosts(niceness) if niceness else None
        self._lock = threading.Lock()  # guards the fields below
        self._busy = False
        self._closed = False
        self._planning: Optional[Planning] = None

    def plan(
        self, world: Tuple[Domain, Problem], domain_path: str, wanted: Wanted, settings: PlannerSettings
    ) -> Tuple[PlanningOutcome, str]:
        """Plans.

        :param world: domain and state; the goals in it do not count.
        :param domain_path: PDDL file of the domain.
        :param settings: of the planner; its time limit is shortened.
        :return: how it ended; and the problem as PDDL text, without `wanted.without` and `include`; empty
            where it cannot be written.
        """
        with self._lock:
            if self._busy or self._closed:
                return PlanningOutcome(PlannerState.CANCELLED, BUSY), ""
            self._busy = True
        try:
            return self._plan(world, domain_path, wanted, settings)
        finally:
            with self._lock:
                self._busy = False
                self._planning = None
                if self._closed:
                    self._folder.cleanup()

    def shutdown(self) -> None:
        """Ends the planning that runs, and plans no more."""
        with self._lock:
            self._closed = True
            if self._planning is not None:
                self._planning.cancel()
            if not self._busy:
                self._folder.cleanup()

    def _plan(
        self, world: Tuple[Domain, Problem], domain_path: str, wanted: Wanted, settings: PlannerSettings
    ) -> Tuple[PlanningOutcome, str]:
        text = ""
        try:
            folder = Path(self._folder.name)
            path = folder / "problem.pddl"
            text = problem = write_goal_problem(*world, wanted.goals)
            if wanted.include:
                domain, state = world
                objects = {name.lower(): kinds for name, kinds in state.objects.items()}
                marked, done = demand(text_of(domain_path), objects, wanted.include)
                state.goals += done
                problem, domain_path = write_problem(state, domain), str(folder / "domain.pddl")
                Path(domain_path).write_text(marked, encoding="utf-8")
            path.write_text(problem, encoding="utf-8")
        except (PddlError, OSError) as error:
            return PlanningOutcome(PlannerState.INVALID, str(error)), text
        limit = min(settings.time_limit or self._limit, self._limit)
        settings = dataclasses.replace(settings, time_limit=limit, without=tuple(wanted.without))
        planning = Planning(settings, domain_path, str(path), hosts=self._hosts)
        with self._lock:
            self._planning = planning
            if self._closed:
                planning.cancel()
        with self._while_wanted(planning.cancel):
            return planning.run(), text


def steps_of(plan: str) -> Sequence[PlanStep]:
    """The steps of a plan in the order of their starts; 0 stands for no duration.

    :raises PlanTextError: when it cannot be read.
    """
    steps = sorted(parse_plan(plan), key=lambda step: step.time) if plan.strip() else []
    return [
        dataclasses.replace(step, duration=step.duration if step.duration > NO_DURATION else 0.0)
        for step in steps
    ]


def write_goal_problem(domain: Domain, problem: Problem, goals: Sequence[str]) -> str:
    """The problem as PDDL text, with these goals in place of its own ones.

    :param problem: a copy of the state; its goals are replaced.
    :param goals: PDDL text.
    :raises PddlError: a goal is not PDDL, or not one of the domain.
    """
    objects = problem.typed(domain.constants)
    problem.goals = [part for text in goals for part in conjuncts(parse_condition(text, domain, objects))]
    problem.instance_goals = []
    return write_problem(problem, domain)


def write_later_problem(domain_path: str, problem_path: str, after: Sequence[str]) -> str:
    """The problem of a file as PDDL text, from where actions that run now have ended.

    :param after: see :func:`.foreseen.after_actions`.
    :raises PddlError, UpdateRefused, OSError: as a sentence, what cannot be read or does not fit.
    """
    domain = read_domain(domain_path)
    with open(problem_path, encoding="utf-8", errors="replace") as file:
        problem = parse_problem(file.read(), domain, problem_path, constraints=True)
    return write_problem(after_actions(domain, problem, after), domain)
