# SPDX-License-Identifier: Apache-2.0
"""Which facts and numbers the actions of a task can reach when nothing is ever lost."""

import itertools
import math
from typing import Dict, List, Sequence, Set, Tuple

from merlin_pddl.analysis.ranges import Range, arithmetic
from merlin_pddl.analysis.relaxed_state import Bindings, RelaxedState
from merlin_pddl.domain import Domain, Operator
from merlin_pddl.evaluation import key_of, result_of
from merlin_pddl.formula import Comparison, Condition, Effect, Number, Numeric
from merlin_pddl.knowledge import ASSIGN, OPERATIONS, Key, conjuncts
from merlin_pddl.problem import Problem

#: How often a number may grow by assignments before it counts as growing without end.
GROWTHS = 20


def conditions_of(operator: Operator) -> List[Condition]:
    """What an action needs, in single conditions, some of them of its duration and its numeric effects.

    Those have values; the duration is not negative, and its bounds leave something between them.
    """
    needed = [part for timed in operator.conditions for part in conjuncts(timed.condition)]
    lowest = [duration.value for duration in operator.durations if duration.op == ">="]
    highest = [duration.value for duration in operator.durations if duration.op != ">="]
    plain = [each for each in operator.effects if each.fluent and not (each.conditions or each.variables)]
    read: List[Numeric] = [*lowest, *map(result_of, plain)]
    # A comparison of a value with itself holds when there is a value.
    bounds = [(value, value) for value in read] + list(itertools.product(highest, [Number(0.0), *lowest]))
    return needed + [Comparison(">=", high, low) for high, low in bounds]


class Reachability:
    """Applies actions until no new fact comes true; :attr:`state` then holds all reachable facts.

    :param end: of the analysis, s of ``time.thread_time``.
    """

    def __init__(self, domain: Domain, problem: Problem, end: float) -> None:
        self._domain = domain
        self.state = RelaxedState(domain, problem, end)
        self._grown: Dict[Key, int] = {}

    def run(self) -> None:
        """Goes to the end.

        :raises CutOffError: the time is over.
        """
        needs = {name: conditions_of(operator) for name, operator in self._domain.operators.items()}
        done: Set[Tuple[str, ...]] = set()
        changed = True
        while changed:
            changed = self._derive()
            for name, operator in self._domain.operators.items():
                for bindings in list(self.state.matches(operator.parameters, needs[name])):
                    ground = (name, *(bindings[parameter.name] for parameter in operator.parameters))
                    if ground not in done:
                        changed |= self._apply(operator.effects, bindings)
                        if not any(effect.fluent or effect.conditions for effect in operator.effects):
                            done.add(ground)

    def _derive(self) -> bool:
        changed, again = False, bool(self._domain.derived)
        while again:
            again = False
            for name, rules in self._domain.derived.items():
                for rule in rules:
                    names = [parameter.name for parameter in rule.head.parameters]
                    found = self.state.matches(rule.head.parameters, conjuncts(rule.body))
                    for bindings in list(found):
                        again |= self.state.add((name, *(bindings[variable] for variable in names)))
            changed |= again
        return changed

    def _apply(self, effects: Sequence[Effect], bindings: Bindings) -> bool:
        changed = False
        for effect in effects:
            for extended in self.state.extend(effect.variables, bindings):
                if not all(self.state.holds(timed.condition, extended) for timed in effect.conditions):
                    continue
                if effect.atom is not None:
                    key = key_of(effect.atom, extended)
                    changed |= self.state.remove(key) if effect.negative else self.state.add(key)
                else:
                    changed |= self._count(effect, extended)
        return changed

    def _count(self, effect: Effect, bindings: Bindings) -> bool:
        """A numeric effect. What changes by its own value does so as often as it likes."""
        assert effect.fluent is not None and effect.value is not None
        key = key_of(effect.fluent, bindings)
        value, old = self.state.range(effect.value, bindings), self.state.values.get(key)
        if value is None or (old is None and effect.op != ASSIGN):
            return False
        if effect.op == ASSIGN or old is None:
            changed = self.state.widen(key, value)
            self._grown[key] = self._grown.get(key, 0) + changed
            if changed and old is not None and self._grown[key] > GROWTHS:
                self.state.widen(key, self._endless(old, value))
            return changed
        new = arithmetic(OPERATIONS[effect.op], [old, value])
        return self.state.widen(key, self._endless(old, new))

    @staticmethod
    def _endless(old: Range, new: Range) -> Range:
        return Range(
            -math.inf if new.low < old.low else old.low, math.inf if new.high > old.high else old.high
        )
