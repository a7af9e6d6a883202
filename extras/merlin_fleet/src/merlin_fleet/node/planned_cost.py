# SPDX-License-Identifier: Apache-2.0
"""The cost of goals for a robot: its own planner plans them from the present state of its knowledge."""

import hashlib
import re
from pathlib import Path
from typing import Callable, List, Optional, Tuple

from merlin_fleet.core.records import Goal
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import open_definition
from merlin_pddl.plan_text import NO_DURATION, PlanTextError, parse_plan
from merlin_pddl.problem import Problem
from merlin_pddl.text_reader import read_expression
from merlin_rosplan.messages.knowledge_snapshot import KnowledgeBaseError, KnowledgeSnapshots
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.plan_preview import PREVIEW_LIMIT, Previews, Wanted

VOCABULARY = (":types", ":constants", ":predicates", ":functions")


class CannotPlan(Exception):
    """A goal cannot be planned; the text says why."""


class Unplanned(CannotPlan):
    """The planner has found no plan for a goal that the domain knows."""


class PlannedCost:
    """Plans goals one by one, each from the present state, and adds up how long the plans take.

    Within an action the state may have no plan: a robot that drives is nowhere. So a goal without one counts
    a stated time while the robot is busy.

    :param knowledge: the robot's knowledge base.
    :param domain_path: its domain's file.
    :param settings: of the planner.
    :param action_duration: s that an action without a duration counts.
    :param goal_duration: s that a goal counts that cannot be planned while the robot is busy.
    :param busy: whether the Executor has something to do.
    """

    def __init__(
        self,
        knowledge: KnowledgeSnapshots,
        domain_path: str,
        settings: PlannerSettings,
        action_duration: float,
        goal_duration: float,
        busy: Callable[[], bool],
    ) -> None:
        self._knowledge = knowledge
        self._domain_path = domain_path
        self._settings = settings
        self._action_duration = action_duration
        self._goal_duration = goal_duration
        self._busy = busy
        self._plans = Previews(settings.time_limit or PREVIEW_LIMIT)

    def cost(self, goal: Goal, behind: Tuple[Goal, ...]) -> Tuple[Optional[float], str]:
        """s until a goal would hold, behind others; None, and why there is no plan. For one thread."""
        busy = bool(behind) or self._busy()
        try:
            domain, problem = self._knowledge.snapshot()
            try:
                own = self._plan(domain, problem, goal)
            except Unplanned:
                if not busy and not self._busy():
                    raise
                own = self._goal_duration
        except (KnowledgeBaseError, CannotPlan) as error:
            return None, str(error)
        for before in behind:
            try:
                own += self._plan(domain, problem, before)
            except Unplanned:
                own += self._goal_duration
            except CannotPlan:
                continue  # the Executor will refuse it: it does not keep the robot
        return own, ""

    def close(self) -> None:
        """Ends a planning that runs, and plans no more."""
        self._plans.shutdown()

    def _plan(self, domain: Domain, problem: Problem, goal: Goal) -> float:
        wanted = Wanted(goal.goals)
        outcome, _ = self._plans.plan((domain, problem), self._domain_path, wanted, self._settings)
        if outcome.solved:
            return length(outcome.plan, self._action_duration)
        if outcome.state is PlannerState.CANCELLED:
            raise CannotPlan("the robot leaves the fleet")
        if outcome.state is PlannerState.INVALID:
            raise CannotPlan(outcome.reason)
        raise Unplanned(f"no plan ({outcome.state.name}): {outcome.reason}")


def length(plan: str, action_duration: float) -> float:
    """How long a plan takes, s.

    :param action_duration: of an action without a duration.
    :raises CannotPlan: when it cannot be read.
    """
    if not plan.strip():
        return 0.0  # the goal holds
    try:
        steps = parse_plan(plan)
    except PlanTextError as error:
        raise CannotPlan(f"the plan cannot be read: {error}") from None
    timed = [step.time + step.duration for step in steps if step.duration > NO_DURATION]
    return max(timed, default=0.0) + action_duration * (len(steps) - len(timed))


class RobotDomain:
    """What a fleet knows of a robot's domain: of the file that its knowledge base has read.

    :param knowledge: the robot's knowledge base.
    :param path: says which file it has read.
    :raises KnowledgeBaseError: it does not answer.
    :raises OSError, PddlError: the file cannot be read, or is not a domain.

    :ivar identity: `home@1a2b3c4d`.
    :ivar vocabulary: what a goal can be about, PDDL.
    """

    def __init__(self, knowledge: KnowledgeSnapshots, path: Callable[[], str]) -> None:
        self._knowledge, self._path = knowledge, path
        self._read = knowledge.domain()
        self.path = path()
        text = Path(self.path).read_text(encoding="utf-8", errors="replace")
        self.identity, self.vocabulary = domain_identity(self._read.name, text), vocabulary(text)

    def replaced(self) -> bool:
        """Whether the knowledge base has begun anew with another domain; raises what the constructor does."""
        domain = self._knowledge.domain()
        another = (
            domain is not self._read and RobotDomain(self._knowledge, self._path).identity != self.identity
        )
        self._read = domain
        return another


def vocabulary(text: str) -> str:
    """What of a domain's text a goal can be about: its types, constants, predicates and functions.

    :raises PddlError: when it is not a domain.
    """
    name, sections = open_definition(read_expression(text, "domain"), "domain")
    kept = [section.text() for section in sections if section.head in VOCABULARY]
    return f"(define (domain {name}) {' '.join(kept)})"


def domain_identity(name: str, text: str) -> str:
    """A domain's name and a hash of what its file says: `home@1a2b3c4d`. Comments and blanks do not count."""
    words: List[str] = re.sub(r";[^\n]*", "", text).replace("(", " ( ").replace(")", " ) ").lower().split()
    return f"{name}@{hashlib.sha256(' '.join(words).encode()).hexdigest()[:8]}"
