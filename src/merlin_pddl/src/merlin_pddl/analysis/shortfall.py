# SPDX-License-Identifier: Apache-2.0
"""Why a task has no plan: which condition no action can reach, and by how much it is missed."""

import itertools
import math
import time
from typing import Dict, FrozenSet, Iterator, List, NamedTuple, Optional, Tuple

from merlin_pddl.analysis.leave_out import LEFT_OUT
from merlin_pddl.analysis.reachability import Reachability, conditions_of
from merlin_pddl.analysis.relaxed_state import CutOffError, RelaxedState
from merlin_pddl.domain import Domain, Operator
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import (
    And,
    Atom,
    Comparison,
    Condition,
    Effect,
    Fluent,
    Not,
    Number,
    ground,
    numeric_text,
    to_pddl,
    walk,
)
from merlin_pddl.knowledge import conjuncts
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.text_reader import PddlError

#: s of processor time for the analysis.
LIMIT = 0.2
#: How many goals are named.
NAMED = 2
#: How many ways to reach a condition are compared.
WAYS = 500
_MIRRORED = {">": "<", ">=": "<=", "<": ">", "<=": ">=", "=": "="}
GIVEN_UP = "it was given up"
CUT_OFF = "why was not found out within {limit:g} s"
TOGETHER = (
    "every goal could be reached for itself: actions undo what others need, or a number does not last for all"
)


class Gap(NamedTuple):
    """A condition that cannot be reached."""

    condition: str
    """The condition as ground PDDL."""
    operator: str
    """Action that needs it; empty: it is the goal itself."""
    why: str
    needed: Condition
    """The condition itself."""
    goal: Condition = And()
    """The goal that cannot be reached; what comes nearest to it lacks the condition."""

    def text(self) -> str:
        """The text as part of a sentence."""
        needed = f" for {self.operator}" if self.operator else ""
        return f"{self.condition}{needed}; {self.why}"


def shortfall(domain: str, problem: str, limit: float = LIMIT) -> Tuple[bool, str]:
    """Why there is no plan.

    :param domain, problem: PDDL text.
    :param limit: s of processor time of this thread.
    :return: whether a condition was found that cannot be reached, and a sentence; empty when the text is not
        PDDL that this reader knows.
    """
    end = time.thread_time() + limit
    try:
        model = parse_domain(domain)
        task = parse_problem(problem, model, constraints=True)
        found = Shortfall(model, task, end - time.thread_time())
        sentences = [_sentence(found.gap(goal)) for goal in found.goals[:NAMED]]
    except CutOffError:
        return False, CUT_OFF.format(limit=limit)
    except (PddlError, KeyError, RecursionError):  # the planner reports such errors
        return False, ""
    if not found.goals:
        return False, TOGETHER
    more = f"; and {len(found.goals) - NAMED} more goals" if len(found.goals) > NAMED else ""
    return True, "; ".join(sentences) + more


def _sentence(gap: Gap) -> str:
    if gap.condition == to_pddl(gap.goal):
        return f"cannot be reached: {gap.text()}"
    return f"{to_pddl(gap.goal)} cannot be reached, it needs {gap.text()}"


class Shortfall:
    """The goals that no action can reach; follows one back to a condition that no action explains.

    :param limit: s of processor time for all that is asked of it.
    :raises CutOffError: the time is over.
    :ivar goals: those goals; none: each can be reached for itself, were nothing ever lost.
    """

    def __init__(self, domain: Domain, task: Problem, limit: float = LIMIT) -> None:
        reach = Reachability(domain, task, time.thread_time() + limit)
        reach.run()
        self._domain = domain
        self._state: RelaxedState = reach.state
        goals = [part for goal in task.goals for part in conjuncts(goal)]
        self.goals = [goal for goal in goals if not self._state.holds(goal, {})]
        effects = (effect for operator in domain.operators.values() for effect in operator.effects)
        self._changed = {effect.atom.name for effect in effects if effect.atom is not None} | set(
            domain.derived
        )

    def gap(self, goal: Condition) -> Gap:
        """What is missing for one of the goals.

        :raises CutOffError: the time is over.
        """
        return self._behind(goal, "", frozenset())._replace(goal=goal)

    def _behind(self, condition: Condition, operator: str, seen: FrozenSet[str]) -> Gap:
        """The reason behind a ground condition.

        :param operator: that needs it.
        :param seen: conditions on the way to it.
        """
        text = to_pddl(condition)
        if isinstance(condition, Comparison):
            subject = self._without_value(condition) or text
            return Gap(subject, operator, self._missed(condition), condition)
        if isinstance(condition, Not) and isinstance(condition.part, Atom):
            atom = condition.part
            if operator and atom.name.startswith(f"{LEFT_OUT}{operator}"):
                action = f"({' '.join((operator, *atom.args))})"
                return Gap(action, "", GIVEN_UP, condition)
            return Gap(text, operator, "no action can make it false", condition)
        if not isinstance(condition, Atom):
            return Gap(text, operator, "it can never hold", condition)
        way = self._way(condition, seen | {text})
        if way is None:
            return Gap(text, operator, "no action can make it true", condition)
        needed, name = way
        return self._behind(needed, name, seen | {text})

    def _way(self, atom: Atom, seen: FrozenSet[str]) -> Optional[Tuple[Condition, str]]:
        """What is missing for the action that comes nearest to an atom, and its operator."""
        best: Optional[Tuple[Tuple[int, int], Condition, str]] = None
        for operator in self._domain.operators.values():
            for effect in operator.effects:
                if effect.atom is None or effect.negative or effect.atom.name != atom.name:
                    continue
                for missing in itertools.islice(self._missing(operator, effect, atom), WAYS):
                    if any(to_pddl(condition) in seen for condition in missing) or not missing:
                        continue
                    # An action on objects that do not belong together is not near, however little it lacks.
                    distance = sum(map(self._apart, missing)), len(missing)
                    if best is None or distance < best[0]:
                        best = distance, max(missing, key=self._apart), operator.name
        return None if best is None else best[1:]

    def _missing(self, operator: Operator, effect: Effect, atom: Atom) -> Iterator[List[Condition]]:
        """For each way in which an effect makes an atom true: the conditions that cannot be reached."""
        assert effect.atom is not None
        bound: Dict[str, str] = {}
        for term, name in zip(effect.atom.args, atom.args):
            if bound.setdefault(term, name.lower()) != name.lower():
                return
        variables = (*operator.parameters, *effect.variables)
        for variable in variables:
            if variable.name in bound and bound[variable.name] not in self._state.objects(variable.types):
                return
        if any(not term.startswith("?") and term.lower() != name for term, name in bound.items()):
            return
        free = [variable for variable in variables if variable.name not in bound]
        needed = conditions_of(operator)
        needed += [part for timed in effect.conditions for part in conjuncts(timed.condition)]
        for bindings in self._state.extend(free, bound):
            yield [ground(need, bindings) for need in needed if not self._state.holds(need, bindings)]

    def _apart(self, condition: Condition) -> int:
        """How many objects a missing condition relates for ever; 0: an action may change it."""
        fixed = isinstance(condition, Atom) and condition.name not in self._changed
        return len(condition.args) if isinstance(condition, Atom) and fixed else 0

    def _missed(self, comparison: Comparison) -> str:
        """By how much a comparison is missed."""
        if self._without_value(comparison):
            return "it has no value"
        op, left, right = comparison.op, comparison.left, comparison.right
        if isinstance(left, Number):
            op, left, right = _MIRRORED[op], right, left
        has, wanted = self._state.range(left, {}), self._state.range(right, {})
        assert has is not None and wanted is not None
        above = op in (">", ">=") or (op == "=" and has.high < wanted.low)
        value, limit = (has.high, wanted.low) if above else (has.low, wanted.high)
        if not (math.isfinite(value) and math.isfinite(limit)):
            return "it can never hold"
        reachable = f"at {'most' if above else 'least'} {_rounded(value)} can be reached"
        return reachable if isinstance(right, Number) else f"{reachable}, {_rounded(limit)} is needed"

    def _without_value(self, comparison: Comparison) -> str:
        """The first function of a comparison that has no value."""
        found = [each for each in walk(comparison) if isinstance(each, Fluent)]
        return next((to_pddl(fluent) for fluent in found if self._state.range(fluent, {}) is None), "")


def _rounded(value: float) -> str:
    return numeric_text(float(f"{value:.6g}"))
