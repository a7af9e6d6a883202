# SPDX-License-Identifier: Apache-2.0
"""Conditions on function values that change by themselves at given times."""

from typing import Iterable, List, Mapping, Optional, Union

from merlin_pddl.analysis.plan_run import PaperState
from merlin_pddl.domain import Domain
from merlin_pddl.evaluation import Evaluator
from merlin_pddl.knowledge import FunctionValue
from merlin_pddl.problem import Problem
from merlin_rosplan.dispatch.operator_model import Conditions, Inequality, PlanTerm
from merlin_rosplan.dispatch.plan_graph import TimedLiteral, TimedValue


class TimedNumbers:
    """The timed values of a plan, and from when on a condition holds because of them.

    :param timed: literals count for expressions, of which only the names are known here.
    :param values: what function terms are worth before, by `PlanTerm.key`.
    :param epsilon: s by which times may be off.
    """

    def __init__(
        self,
        timed: Iterable[Union[TimedLiteral, TimedValue]],
        values: Mapping[PlanTerm, float],
        epsilon: float,
    ) -> None:
        self._entries = sorted(timed, key=lambda entry: entry.time)
        self._values = dict(values)
        self._epsilon = epsilon

    def __bool__(self) -> bool:
        return bool(self._entries)

    def since(self, conditions: Conditions, now: float, changed: Mapping[PlanTerm, float]) -> Optional[float]:
        """The time, s, that the conditions of a node have to wait for; None when there is none.

        :param now: planned time of the node, s.
        :param changed: when actions of the plan changed a term last; what it is worth then is not known.
        """
        found = [self._since(entry, now, changed) for entry in conditions.comparisons]
        for expression in conditions.expressions:
            found += [e.time for e in self._past(now) if _name(e) in expression.reads][-1:]
        return max((time for time in found if time is not None), default=None)

    def _past(self, now: float) -> List[Union[TimedLiteral, TimedValue]]:
        return [entry for entry in self._entries if entry.time <= now + self._epsilon]

    def _since(self, entry: Inequality, now: float, changed: Mapping[PlanTerm, float]) -> Optional[float]:
        terms = {term.key for term in entry.reads}
        last_change = max((changed[term] for term in terms if term in changed), default=None)
        past = [
            timed for timed in self._past(now) if isinstance(timed, TimedValue) and timed.term.key in terms
        ]
        if not past:
            return None
        if last_change is not None:  # the values before it are not known
            return past[-1].time if past[-1].time > last_change else None
        values = {term: self._values[term] for term in terms if term in self._values}
        held = [comparison_holds(entry, values)]
        for timed in past:
            values[timed.term.key] = timed.value
            held.append(comparison_holds(entry, values))
        first = len(held) - 1
        while first > 0 and held[first - 1]:
            first -= 1
        return past[first - 1].time if first > 0 else None


def _name(entry: Union[TimedLiteral, TimedValue]) -> str:
    return (entry.atom if isinstance(entry, TimedLiteral) else entry.term).name.lower()


def comparison_holds(entry: Inequality, values: Mapping[PlanTerm, float]) -> bool:
    """Whether a ground comparison holds with these values of its terms; without one of them it does not."""
    problem = Problem("", "", values=[FunctionValue(*term, value) for term, value in values.items()])
    domain = Domain("")
    return Evaluator(domain, PaperState(domain, problem)).holds(entry.condition)
