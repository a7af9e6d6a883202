# SPDX-License-Identifier: Apache-2.0
"""The planning domain: what can exist, what can be true, what can be done."""

from dataclasses import dataclass, field
from typing import Dict, FrozenSet, List, Mapping, Optional, Set, Tuple

from merlin_pddl.formula import (
    START,
    And,
    Atom,
    Condition,
    Effect,
    Exists,
    Forall,
    Not,
    Numeric,
    Or,
    Preference,
    Special,
    TimedCondition,
    Variable,
    terms,
)
from merlin_pddl.knowledge import Key
from merlin_pddl.type_hierarchy import OBJECT, TypeHierarchy


@dataclass(frozen=True)
class Signature:
    """Name and parameters of a predicate, function or operator."""

    name: str
    parameters: Tuple[Variable, ...] = ()


@dataclass(frozen=True)
class Duration:
    """A constraint on ``?duration`` of a durative action: `op` is ``=``, ``<=`` or ``>=``."""

    op: str
    value: Numeric


@dataclass(frozen=True)
class Operator(Signature):
    """An action. Conditions and effects of a plain one carry the time START."""

    durative: bool = False
    durations: Tuple[Duration, ...] = ()
    conditions: Tuple[TimedCondition, ...] = ()
    effects: Tuple[Effect, ...] = ()


@dataclass(frozen=True)
class Derived:
    """A rule: the head holds for all objects for which the body holds."""

    head: Signature
    body: Condition


#: Derived predicate → its rules.
Rules = Mapping[str, List[Derived]]


@dataclass
class Domain:
    """A domain as its file declares it, in the order of the file. Names are lower-case."""

    name: str
    types: TypeHierarchy = field(default_factory=TypeHierarchy)
    constants: Dict[str, Tuple[str, ...]] = field(default_factory=dict)
    predicates: Dict[str, Signature] = field(default_factory=dict)
    functions: Dict[str, Signature] = field(default_factory=dict)
    operators: Dict[str, Operator] = field(default_factory=dict)
    derived: Dict[str, List[Derived]] = field(default_factory=dict)
    preferences: FrozenSet[str] = frozenset()  # their names
    #: for each trajectory constraint the predicates and functions that it reads, with objects and variables
    #: of its `forall`; an empty argument, or one that is missing, stands for any object
    constraints: Tuple[FrozenSet[Key], ...] = ()
    timed_constraints: Tuple[str, ...] = ()  # the texts of those with times, which only a plan keeps
    digest: str = ""  # of the file's content: shows whether stored knowledge belongs to this domain

    def constants_of(self, type_name: str, subtypes: bool = True) -> List[str]:
        """Constants of a type, in the order of their declaration; with `subtypes` also of types below it."""
        wanted = self.types.subtypes(type_name) if subtypes else {type_name}
        return [name for name, types in self.constants.items() if wanted & set(types)]

    def only_constant(self, types: Tuple[str, ...]) -> Optional[str]:
        """The constant of these types if there is exactly one."""
        found = {name for type_name in types for name in self.constants_of(type_name)}
        return found.pop() if len(found) == 1 else None

    def implies(self, name: str, type_name: str) -> bool:
        """Whether the declaration of a constant says already that it is of a type."""
        declared = self.constants.get(name.lower())
        return declared is not None and self.accepts((type_name.lower(),), declared)

    def type_name(self, types: Tuple[str, ...]) -> str:
        """One type name for messages, which know no `either`: the nearest type that covers all of them."""
        return types[0] if len(types) == 1 else self.types.common(types)

    def accepts(self, wanted: Tuple[str, ...], actual: Tuple[str, ...]) -> bool:
        """Whether an object of the `actual` types may stand where the `wanted` ones are asked."""
        return any(self.types.is_a(a, w) for w in wanted for a in actual) or OBJECT in wanted


def used_predicates(condition: Condition, negated: bool = False) -> Set[Tuple[str, bool]]:
    """Names of the predicates in a condition, each with whether it stands there negated."""
    if isinstance(condition, Atom):
        return {(condition.name, negated)}
    if isinstance(condition, (And, Or)):
        return {found for part in condition.parts for found in used_predicates(part, negated)}
    if isinstance(condition, Not):
        return used_predicates(condition.part, not negated)
    if isinstance(condition, (Forall, Exists, Preference)):
        return used_predicates(condition.part, negated)
    return set()


def depends_on(condition: Condition, derived: Rules) -> FrozenSet[str]:
    """The predicates and functions that a condition depends on, through rules too."""
    names: Set[str] = set()
    waiting = [term.name for term in terms(condition)]
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            waiting.extend(term.name for rule in derived.get(name, ()) for term in terms(rule.body))
    return frozenset(names)


def open_terms(operator: Operator, effect: Effect) -> List[Special]:
    """The ``?duration`` and ``#t`` in an effect, where the operator does not fix how long it lasts."""
    if effect.value is None or any(duration.op == "=" for duration in operator.durations):
        return []
    return [
        each for each in terms(effect.value) if isinstance(each, Special) and each.name in ("?duration", "#t")
    ]


def open_advice(effect: Effect, term: Special) -> str:
    """Why such an effect has no number as long as the action has not ended, and what to write."""
    other = ", or make it an effect at end" if effect.when == START else ""
    return f"{term.name} is not known, as its :duration has no '='; write (= ?duration …){other}"


def self_negating(derived: Rules) -> Optional[str]:
    """A derived predicate that depends on its own negation, if there is one: it would mean nothing."""
    uses = {
        name: set().union(*(used_predicates(rule.body) for rule in rules)) for name, rules in derived.items()
    }

    def reaches(start: str, goal: str) -> bool:
        found = [start]
        for name in found:
            found.extend({used for used, _ in uses.get(name, ())}.difference(found))
        return goal in found

    for name, found in uses.items():
        if any(negated and reaches(used, name) for used, negated in found):
            return name
    return None
