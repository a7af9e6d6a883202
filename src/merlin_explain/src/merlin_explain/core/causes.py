# SPDX-License-Identifier: Apache-2.0
"""Which steps of a plan and which goals a step serves.

A link is real if, the step removed and all others carried out, a condition or a goal fails. That is tried on
paper for every link that is named, and where kairos is installed its validator has to find the same.
"""

from typing import Dict, FrozenSet, List, NamedTuple, Sequence

from merlin_explain.claims import QuestionError
from merlin_explain.core.judge import Judge
from merlin_explain.core.wording import plain
from merlin_pddl.analysis.plan_run import GOAL, PlanRun, PlanRunError, Unmet
from merlin_pddl.checks.kairos_check import available
from merlin_pddl.formula import Condition, to_pddl
from merlin_pddl.plan_text import PlanStep

NOT_FITTING = (
    "the last plan and the last problem of the planning system do not belong together; a plan is being made: "
    "ask again when it is there"
)


class Link(NamedTuple):
    """A step makes a condition true that a later step needs, or a goal.

    :ivar giver: number of the step, from 0.
    :ivar taker: likewise; :data:`GOAL`: it is a goal.
    :ivar when: the taker needs it: ``start``, ``over all``, ``end``; empty for a goal.
    :ivar condition: ground.
    """

    giver: int
    taker: int
    when: str
    condition: Condition

    @property
    def text(self) -> str:
        """The condition as PDDL."""
        return to_pddl(self.condition)


class Causes:
    """Looks for links in one plan.

    :param judge: of its problem.
    :param steps: the plan.
    :raises QuestionError: the plan does not solve the problem.
    """

    def __init__(self, judge: Judge, steps: Sequence[PlanStep]) -> None:
        self.judge = judge
        self.steps = list(steps)
        try:
            self._run = PlanRun(judge.domain, judge.problem, self.steps)
        except PlanRunError as error:
            raise QuestionError(f"{NOT_FITTING} ({error})") from error
        self.goals = self._run.goals
        self._failing: Dict[FrozenSet[int], List[Unmet]] = {}
        broken = self._unmet()
        if broken:
            raise QuestionError(f"{NOT_FITTING} ({to_pddl(broken[0].condition)} does not hold)")

    def find(self, text: str) -> List[int]:
        """The numbers of the steps that are an action, as PDDL text, from 0."""
        return [number for number, step in enumerate(self.steps) if str(step).lower() == plain(text)]

    def links(self, giver: int) -> List[Link]:
        """What fails when a step is removed and all others are carried out; goals first."""
        found = [Link(giver, each.step, each.when, each.condition) for each in self._unmet(giver)]
        return [] if self.doubted(giver) else sorted(found, key=lambda link: link.taker)

    def goals_served(self, giver: int) -> List[Condition]:
        """The goals that fail when a step is removed, and with it each step that fails then, one by one."""
        run = self._run.run({giver}, falling=True)
        return [each.condition for each in run.unmet if each.step == GOAL]

    def needless(self, number: int) -> bool:
        """Whether the plan is right without a step, by every witness."""
        return not self._unmet(number) and not self._fault(number)

    def doubted(self, number: int) -> bool:
        """Whether the validator accepts the plan without a step, although a condition fails on paper."""
        return available() and bool(self._unmet(number)) and not self._fault(number)

    def achievers(self, goal: Condition) -> List[int]:
        """The steps without which a goal is not reached."""
        serving = [number for number in range(len(self.steps)) if goal in self.goals_served(number)]
        return [number for number in serving if not self.doubted(number)]

    def holds_before(self, goal: Condition) -> bool:
        """Whether a goal holds in the state for which the plan was made."""
        return self._run.run(frozenset(range(len(self.steps)))).reached.get(goal) == 0.0

    def _unmet(self, *left_out: int) -> List[Unmet]:
        key = frozenset(left_out)
        if key not in self._failing:
            unmet = self._run.run(key).unmet
            self._failing[key] = [each for each in unmet if each.step not in key]
        return self._failing[key]

    def _fault(self, number: int) -> str:
        rest = [step for each, step in enumerate(self.steps) if each != number]
        return self.judge.checked(rest)
