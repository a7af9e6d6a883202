# SPDX-License-Identifier: Apache-2.0
"""What can hold at all when nothing is ever lost: facts that come true stay, numbers become ranges.

Whatever a plan can reach can be reached here too; what cannot be reached here has no plan.
"""

import time
from typing import Dict, Iterator, Mapping, Optional, Sequence, Set, Tuple

from merlin_pddl.analysis.plan_run import PaperState
from merlin_pddl.analysis.ranges import ANYTHING, POSITIVE, Range, arithmetic, can_compare
from merlin_pddl.domain import Domain
from merlin_pddl.evaluation import Bindings, Evaluator, key_of
from merlin_pddl.formula import (
    Arithmetic,
    Atom,
    Comparison,
    Condition,
    Fluent,
    Number,
    Numeric,
    Special,
    Variable,
)
from merlin_pddl.knowledge import Fact, FunctionValue, Key
from merlin_pddl.problem import Problem

Grounds = Set[Tuple[str, ...]]


class CutOffError(Exception):
    """The time for the analysis is over."""


class RelaxedState(Evaluator):
    """The facts and numbers that were reached so far: what holds is what can hold.

    :param end: of the analysis, s of ``time.thread_time``.
    """

    def __init__(self, domain: Domain, problem: Problem, end: float) -> None:
        super().__init__(domain, PaperState(domain, problem), between=self.look_at_clock)
        self._end = end
        self.facts: Dict[str, Grounds] = {}
        """Predicate → its arguments for which it can hold."""
        self.values: Dict[Key, Range] = {}
        """Function with arguments → what it can become; one that never has a value is missing."""
        for fact in problem.facts:
            if not fact.negative:
                self.add(fact.key)
        self._initial = {(name, *args) for name, found in self.facts.items() for args in found}
        self._gone: Set[Key] = set()
        for value in problem.values:
            self.values[value.key] = Range(value.value, value.value)
        for item in (timed.item for timed in problem.timed):
            if isinstance(item, Fact):
                (self.remove if item.negative else self.add)(item.key)
            elif isinstance(item, FunctionValue):
                self.widen(item.key, Range(item.value, item.value))

    def look_at_clock(self) -> None:
        """Ends the analysis in time.

        :raises CutOffError: the time is over.
        """
        if time.thread_time() > self._end:
            raise CutOffError()

    # --- what comes true ----------------------------------------------------------------------------------

    def add(self, key: Key) -> bool:
        """A fact can hold; returns whether that is new."""
        found = self.facts.setdefault(key[0], set())
        if key[1:] in found:
            return False
        found.add(key[1:])
        return True

    def remove(self, key: Key) -> bool:
        """A fact can be lost, which matters for those that hold at the start; returns whether that is new."""
        if key not in self._initial or key in self._gone:
            return False
        self._gone.add(key)
        return True

    def widen(self, key: Key, value: Range) -> bool:
        """A number can get a value; returns whether that is new."""
        old = self.values.get(key)
        new = value if old is None else old.joined(value)
        self.values[key] = new
        return new != old

    # --- what can hold ------------------------------------------------------------------------------------

    def literal(self, key: Key, sense: bool) -> bool:
        """Whether a fact can hold, or else whether it can fail."""
        if sense:
            return key[1:] in self.facts.get(key[0], ())
        return key[0] in self._domain.derived or key not in self._initial or key in self._gone

    def compares(self, comparison: Comparison, bindings: Bindings, sense: bool) -> bool:
        """Whether a comparison can hold, or else whether it can fail; without a value neither."""
        left, right = self.range(comparison.left, bindings), self.range(comparison.right, bindings)
        return left is not None and right is not None and can_compare(comparison.op, left, right, not sense)

    def range(self, value: Numeric, bindings: Bindings) -> Optional[Range]:
        """What an expression can be worth; None when a function in it never has a value."""
        if isinstance(value, Number):
            return Range(value.value, value.value)
        if isinstance(value, Fluent):
            return self.values.get(key_of(value, bindings))
        if isinstance(value, Arithmetic):
            parts = [self.range(part, bindings) for part in value.parts]
            known = [part for part in parts if part is not None]
            return arithmetic(value.op, known) if len(known) == len(parts) else None
        assert isinstance(value, Special)
        return POSITIVE if value.name in ("#t", "?duration", "total-time") else ANYTHING

    # --- bindings -------------------------------------------------------------------------------------------

    def matches(
        self, variables: Sequence[Variable], conditions: Sequence[Condition]
    ) -> Iterator[Dict[str, str]]:
        """All bindings of variables for which conditions can hold."""
        atoms = [condition for condition in conditions if isinstance(condition, Atom)]
        atoms.sort(key=lambda atom: len(self.facts.get(atom.name.lower(), ())))
        others = [condition for condition in conditions if not isinstance(condition, Atom)]
        typed = {variable.name: variable.types for variable in variables}
        for found in self._join(atoms, 0, {}, typed):
            left = [variable for variable in variables if variable.name not in found]
            for bindings in self.extend(left, found):
                if all(self.holds(condition, bindings) for condition in others):
                    yield bindings

    def _join(
        self, atoms: Sequence[Atom], at: int, found: Dict[str, str], typed: Mapping[str, Tuple[str, ...]]
    ) -> Iterator[Dict[str, str]]:
        if at == len(atoms):
            yield found
            return
        self.look_at_clock()
        atom = atoms[at]
        for args in list(self.facts.get(atom.name.lower(), ())):
            more = dict(found)
            for term, name in zip(atom.args, args):
                if not term.startswith("?"):
                    if term.lower() != name:
                        break
                elif more.setdefault(term, name) != name or name not in self.objects(typed[term]):
                    break
            else:
                yield from self._join(atoms, at + 1, more, typed)
