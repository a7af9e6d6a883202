# SPDX-License-Identifier: Apache-2.0
"""Whether a condition holds, and what a numeric expression is worth, in a state of the world."""

import functools
import itertools
import math
import operator
from typing import Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Set, Tuple, Union

from merlin_pddl.domain import Domain
from merlin_pddl.formula import (
    And,
    Arithmetic,
    Atom,
    Comparison,
    Condition,
    Effect,
    Equal,
    Exists,
    Fluent,
    Forall,
    Not,
    Number,
    Numeric,
    Or,
    Preference,
    Special,
    Variable,
)
from merlin_pddl.knowledge import ASSIGN, OPERATIONS, Fact, FunctionValue, Instance, Key, Timed

_COMPARE = {">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le, "=": operator.eq}
_ARITHMETIC = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}
Bindings = Mapping[str, str]

#: What plans cost.
TOTAL_COST = Fluent("total-cost")

#: Derived atoms inside each other before the search starts afresh: keeps within Python's recursion limit.
_MAX_OPEN = 20
#: Combinations of objects that are looked at between two calls of ``between``.
_STRIDE = 1024


class WorldState:
    """What an :class:`Evaluator` asks; names and objects are lower-case."""

    def holds(self, key: Key) -> bool:
        """Whether that fact is stored."""
        raise NotImplementedError

    def value(self, key: Key) -> Optional[float]:
        """The value of that function, None when it has none."""
        raise NotImplementedError

    def objects(self, types: Tuple[str, ...]) -> List[str]:
        """The objects of any of these types or of types below them."""
        raise NotImplementedError


class Evaluator:
    """Evaluates formulas of a domain in a state.

    :param domain: knows which predicates are derived and how.
    :param state: what holds; must not change during a call.
    :param specials: values of ``?duration``, ``#t`` and so on; one that is missing has no value.
    :param between: called now and then while a quantifier goes through the objects; what it raises ends that.
    :ivar objects: as :meth:`WorldState.objects`.
    """

    def __init__(
        self,
        domain: Domain,
        state: WorldState,
        specials: Optional[Mapping[str, float]] = None,
        between: Callable[[], None] = lambda: None,
    ) -> None:
        self._domain = domain
        self._state = state
        self._specials: Mapping[str, float] = specials or {}
        self._between = between
        self._proven: Set[Key] = set()
        self._refuted: Set[Key] = set()
        self._open: Set[Key] = set()
        self._failed: Set[Key] = set()
        self._postponed: List[Key] = []
        # Asked once per type, not once per binding.
        self.objects = functools.lru_cache(maxsize=None)(lambda types: state.objects(types))

    def holds(self, condition: Condition, bindings: Optional[Bindings] = None, sense: bool = True) -> bool:
        """Whether a condition holds. What was never said is false; a comparison without a value is, and its
        negation too, as for kairos.

        :param sense: False asks whether its negation holds.
        """
        bindings = bindings or {}
        if isinstance(condition, Not):
            return self.holds(condition.part, bindings, not sense)
        if isinstance(condition, (And, Or)):
            every = all if isinstance(condition, And) == sense else any
            return every(self.holds(part, bindings, sense) for part in condition.parts)
        if isinstance(condition, (Forall, Exists)):
            every = all if isinstance(condition, Forall) == sense else any
            extended = self.extend(condition.variables, bindings)
            return every(self.holds(condition.part, each, sense) for each in extended)
        if isinstance(condition, Comparison):
            return self.compares(condition, bindings, sense)
        if isinstance(condition, Equal):
            return same_object(condition, bindings) == sense
        if isinstance(condition, Atom):
            return self.literal(key_of(condition, bindings), sense)
        assert isinstance(condition, Preference)
        return sense

    def compares(self, comparison: Comparison, bindings: Bindings, sense: bool) -> bool:
        """Whether a comparison holds; `sense` as of :meth:`holds`."""
        left, right = self.number(comparison.left, bindings), self.number(comparison.right, bindings)
        return left is not None and right is not None and compare(comparison.op, left, right) == sense

    def literal(self, key: Key, sense: bool) -> bool:
        """Whether a fact holds, stored or derived; `sense` as of :meth:`holds`."""
        return self._atom(key) if sense else self._negation(key)

    def number(self, value: Numeric, bindings: Optional[Bindings] = None) -> Optional[float]:
        """The worth of an expression; None when a function in it has no value, or on division by zero."""
        bindings = bindings or {}
        if isinstance(value, Number):
            return value.value
        if isinstance(value, Fluent):
            return self._state.value(key_of(value, bindings))
        if isinstance(value, Arithmetic):
            return arithmetic(value.op, [self.number(part, bindings) for part in value.parts])
        assert isinstance(value, Special)
        return self._specials.get(value.name)

    def extend(self, variables: Sequence[Variable], bindings: Bindings) -> Iterator[Dict[str, str]]:
        """All bindings with every combination of objects for further variables."""
        choices: List[List[str]] = [self.objects(variable.types) for variable in variables]
        for number, objects in enumerate(itertools.product(*choices)):
            if not number % _STRIDE:
                self._between()
            yield {**bindings, **{v.name: obj for v, obj in zip(variables, objects)}}

    # --- derived predicates: the least fixpoint, searched from the atom that is asked -------------
    #
    # One round proves what it can, assuming false what is being proven already and what failed before in
    # the same round. Rounds repeat until one proves nothing new: then the assumptions were right.

    def _atom(self, key: Key) -> bool:
        if self._state.holds(key) or key in self._proven:
            return True
        if key[0] not in self._domain.derived or key in self._refuted:
            return False
        if not self._open:
            return self._prove(key)
        if key in self._open or key in self._failed:
            return False
        if len(self._open) >= _MAX_OPEN:
            self._postponed.append(key)
            return False
        return self._attempt(key)

    def _prove(self, key: Key) -> bool:
        while True:
            known = len(self._proven)
            self._failed.clear()
            self._postponed = [key]
            while self._postponed and key not in self._proven:
                root = self._postponed.pop()
                if root not in self._failed and root not in self._proven:
                    self._attempt(root)
            if key in self._proven:
                return True
            if len(self._proven) == known:
                self._refuted |= self._failed
                return False

    def _attempt(self, key: Key) -> bool:
        self._open.add(key)
        try:
            for rule in self._domain.derived[key[0]]:
                names = [parameter.name for parameter in rule.head.parameters]
                if len(names) == len(key) - 1 and self.holds(rule.body, dict(zip(names, key[1:]))):
                    self._proven.add(key)
                    return True
        finally:
            self._open.discard(key)
        self._failed.add(key)
        return False

    def _negation(self, key: Key) -> bool:
        """What is negated belongs to a lower stratum: it is settled completely before it counts."""
        kept = self._open, self._failed, self._postponed
        self._open, self._failed, self._postponed = set(), set(), []
        try:
            return not self._atom(key)
        finally:
            self._open, self._failed, self._postponed = kept


def key_of(term: Union[Atom, Fluent, Special], bindings: Bindings) -> Key:
    """The key of what a term names. A variable without a value stays: a client may ask about ``?x``."""
    return (term.name.lower(), *[bindings.get(arg, arg).lower() for arg in term.args])


def same_object(condition: Equal, bindings: Bindings) -> bool:
    """Whether the two terms stand for one object."""
    left, right = (bindings.get(term, term).lower() for term in (condition.left, condition.right))
    return left == right


def compare(op: str, left: float, right: float) -> bool:
    """``> >= < <= =``; numbers within 1e-9 of each other are equal, for they come from sums of decimals."""
    if math.isclose(left, right, rel_tol=1e-9, abs_tol=1e-9):
        return op in (">=", "<=", "=")
    return bool(_COMPARE[op](left, right))


def changed(op: str, before: Optional[float], value: Optional[float]) -> Optional[float]:
    """What a function is worth after ``assign``, ``increase``, …; None when that is not a number."""
    return value if op == ASSIGN else arithmetic(OPERATIONS[op], (before, value))


def result_of(effect: Effect) -> Numeric:
    """What has to have a value when a numeric effect comes: what its function is worth afterwards.

    ``total-cost`` only rates plans, and need not have a value that is increased.
    """
    assert effect.fluent is not None and effect.value is not None
    if effect.op == ASSIGN or effect.fluent == TOTAL_COST:
        return effect.value
    return Arithmetic(OPERATIONS[effect.op], (effect.fluent, effect.value))


def assigned(timed: Iterable[Timed], values: Mapping[Key, float]) -> List[Timed]:
    """Timed items by time, with the values that functions get: PDDL has no other timed change of a number.

    An increase of what has no value is left out: nothing changes when its time comes.

    :param values: of now.
    """
    known = dict(values)
    found: List[Timed] = []
    for row in sorted(timed, key=lambda row: row.at):
        item = row.item
        if isinstance(item, (Fact, Instance)):
            found.append(row)
            continue
        value = changed(item.op, known.get(item.key), item.value)
        if value is not None:
            known[item.key] = value
            found.append(Timed(row.at, FunctionValue(item.name, item.args, value, item.since)))
    return found


def arithmetic(op: str, values: Sequence[Optional[float]]) -> Optional[float]:
    """The result of ``+ - * /``; None when an operand has no value, on division by zero and on overflow."""
    known = [value for value in values if value is not None]
    if len(known) != len(values) or not known:
        return None
    if len(known) == 1:
        return -known[0] if op == "-" else known[0]
    try:
        result: float = functools.reduce(_ARITHMETIC[op], known)
    except (ZeroDivisionError, OverflowError):
        return None
    return result if math.isfinite(result) else None
