# SPDX-License-Identifier: Apache-2.0
"""Shortcuts in a plan: two consecutive actions of one operator are replaced by one, or by none.

A search that looks for a plan at all, not for a short one, lets robots that wait drive there and back.
"""

from typing import Callable, Iterator, List, Optional, Tuple

from merlin_pddl.analysis.plan_run import PaperState
from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.domain import Operator
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.evaluation import Evaluator
from merlin_pddl.plan_text import NO_DURATION, PlanStep
from merlin_pddl.problem_reader import parse_problem

MOST_TRIES = 60  # validations

Plan = List[PlanStep]


class PlanShortcuts:
    """Takes the shortcuts in plans for one problem; what does not validate is not taken.

    :param domain, problem: PDDL text.
    :param validator: of that problem.
    :raises PddlError: they cannot be read.
    """

    def __init__(self, domain: str, problem: str, validator: PlanValidator) -> None:
        self._domain = parse_domain(domain)
        start = PaperState(self._domain, parse_problem(problem, self._domain))
        self._numbers = Evaluator(self._domain, start)
        self._validator = validator

    def taken(self, plan: Plan, may_go_on: Callable[[], bool] = lambda: True) -> Plan:
        """A valid plan without its detours. What makes it worse by the problem's metric is not taken.

        :param may_go_on: asked before each validation, which takes a second where the problem is large.
        """
        tries = MOST_TRIES
        while True:
            for shorter in self._shorter(plan):
                if not tries or not may_go_on():
                    return plan
                tries -= 1
                if self._validator.fault(shorter) is None and self._is_as_good(shorter, plan):
                    plan = shorter
                    break
            else:
                return plan

    def _is_as_good(self, shorter: Plan, plan: Plan) -> bool:
        return self._validator.quality(shorter).order() <= self._validator.quality(plan).order()

    def _shorter(self, plan: Plan) -> Iterator[Plan]:
        """Plans with one shortcut each, which may be wrong."""
        for first, second, joined in _detours(plan):
            rest = [step for step in plan if step is not first and step is not second]
            if len(set(joined)) < len(set(first.arguments)):  # back to where it began
                yield rest
            else:
                yield from self._direct(rest, first, second, joined)

    def _direct(
        self, rest: Plan, first: PlanStep, second: PlanStep, arguments: Tuple[str, ...]
    ) -> Iterator[Plan]:
        duration = self._duration(first.name, arguments)
        if duration is None:
            return
        late = max(first.time, second.time + second.duration - duration)
        for time in dict.fromkeys((first.time, late)):
            step = PlanStep(time, first.name, arguments, duration)
            yield sorted([*rest, step], key=lambda one: one.time)

    def _duration(self, name: str, arguments: Tuple[str, ...]) -> Optional[float]:
        """s of an action as planned in the initial state; None: that is not known."""
        operator: Optional[Operator] = self._domain.operators.get(name.lower())
        if operator is None:
            return None
        if not operator.durative:
            return NO_DURATION
        if [constraint.op for constraint in operator.durations] != ["="]:
            return None
        bindings = {variable.name: value for variable, value in zip(operator.parameters, arguments)}
        return self._numbers.number(operator.durations[0].value, bindings)


def has_detours(plan: Plan) -> bool:
    """Whether a plan may have shortcuts."""
    return next(_detours(plan), None) is not None


def _detours(plan: Plan) -> Iterator[Tuple[PlanStep, PlanStep, Tuple[str, ...]]]:
    """Pairs of consecutive actions, and the arguments of the one action that can replace both."""
    steps = sorted(plan, key=lambda step: step.time)
    for index, first in enumerate(steps):
        for later, second in enumerate(steps[index + 1 :], index + 1):
            joined = _joined(first, second)
            if joined is not None:
                if not any(_uses(step, first, second) for step in steps[index + 1 : later]):
                    yield first, second, joined
                break  # a later one would jump over this one


def _joined(first: PlanStep, second: PlanStep) -> Optional[Tuple[str, ...]]:
    """The arguments of one action for two: (drive a x y), (drive a y z) → a x z; None: they are not so."""
    if first.name != second.name or len(first.arguments) != len(second.arguments):
        return None
    pairs = list(zip(first.arguments, second.arguments))
    differing = [place for place, (one, other) in enumerate(pairs) if one != other]
    if len(differing) == 2:
        from_, to = differing
        if first.arguments[to] == second.arguments[from_]:
            return (*first.arguments[:to], second.arguments[to], *first.arguments[to + 1 :])
    return None


def _uses(step: PlanStep, first: PlanStep, second: PlanStep) -> bool:
    """Whether an action between two needs what the first one has reached, as far as its arguments tell."""
    common = set(first.arguments) & set(second.arguments)
    return common <= set(step.arguments)
