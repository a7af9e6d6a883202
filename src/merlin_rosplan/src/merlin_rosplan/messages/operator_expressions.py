"""What a DomainOperator message cannot carry of an operator, from the domain itself.

Disjunctions, quantifiers, numeric equality and derived predicates; conditional, quantified and continuous
effects; whether it is durative. Parser and dispatcher take the domain from the knowledge base in their
process, or from its file.
"""

import dataclasses
from typing import FrozenSet, Iterable, List, Mapping, Set

from merlin_pddl.domain import Derived, Domain
from merlin_pddl.formula import (
    END,
    OVER_ALL,
    START,
    And,
    Arithmetic,
    Atom,
    Comparison,
    Condition,
    Effect,
    Exists,
    Fluent,
    Forall,
    Not,
    Numeric,
    Or,
    Preference,
    Special,
)
from merlin_rosplan.dispatch.operator_model import Conditions, TimedEffects, TimedOperator, WatchedCondition
from merlin_rosplan.messages.domain_messages import literals


def with_expressions(operator: TimedOperator, domain: Domain) -> TimedOperator:
    """An operator that was read from a message, with the rest of its conditions and effects.

    :param operator: not grounded.
    :param domain: it is one of this domain's.
    """
    known_operator = domain.operators[operator.name.lower()]
    conditions = known_operator.conditions

    def complete(known: Conditions, when: str) -> Conditions:
        found = [
            part for timed in conditions if timed.when == when for part in _rest(timed.condition, domain)
        ]
        return dataclasses.replace(
            known,
            # A derived fact changes when what it is derived from does: it is watched as an expression.
            positive=tuple(atom for atom in known.positive if atom.name.lower() not in domain.derived),
            negative=tuple(atom for atom in known.negative if atom.name.lower() not in domain.derived),
            expressions=tuple(
                WatchedCondition(part, _names(part, domain.derived)) for part in found if not _special(part)
            ),
        )

    return dataclasses.replace(
        operator,
        at_start=complete(operator.at_start, START),
        over_all=complete(operator.over_all, OVER_ALL),
        at_end=complete(operator.at_end, END),
        start_effects=_with_wild(operator.start_effects, known_operator.effects, START, domain),
        end_effects=_with_wild(operator.end_effects, known_operator.effects, END, domain),
        durative=known_operator.durative,
    )


def _with_wild(effects: TimedEffects, written: Iterable[Effect], when: str, domain: Domain) -> TimedEffects:
    """The effects at one time, with the names that effects change which a message cannot carry.

    A continuous effect is applied at the end of its action, with all the time that has passed.
    """
    changed: Set[str] = set()
    read: Set[str] = set()
    for effect in written:
        if not (effect.variables or effect.conditions or effect.when == OVER_ALL):
            continue
        if (effect.when == START) == (when == START):
            target = effect.atom or effect.fluent
            changed.update([target.name] if target is not None else [])
            read.update(term.name for term in (_terms(effect.value) if effect.value is not None else []))
        for timed in effect.conditions:
            if (timed.when == START) == (when == START):
                read |= _names(timed.condition, domain.derived)
    return dataclasses.replace(effects, wild=frozenset(changed), wild_reads=frozenset(read))


def _rest(condition: Condition, domain: Domain) -> List[Condition]:
    """The conjuncts that are not lists of literals, and the derived ones among the literals."""
    if isinstance(condition, And):
        return [found for part in condition.parts for found in _rest(part, domain)]
    if isinstance(condition, Not) and isinstance(condition.part, Or):
        return [found for part in condition.part.parts for found in _rest(Not(part), domain)]
    if isinstance(condition, Not) and isinstance(condition.part, Not):
        return _rest(condition.part.part, domain)
    if isinstance(condition, Or) and len(condition.parts) == 1:
        return _rest(condition.parts[0], domain)
    if isinstance(condition, Preference):
        return []
    atom = condition.part if isinstance(condition, Not) else condition
    if isinstance(atom, Atom) and atom.name in domain.derived:
        return [condition]
    return [] if literals(condition) else [condition]


def _names(condition: Condition, derived: Mapping[str, List[Derived]]) -> FrozenSet[str]:
    """The predicates and functions that a condition depends on, through rules too."""
    names: Set[str] = set()
    waiting = [term.name for term in _terms(condition)]
    while waiting:
        name = waiting.pop()
        if name not in names:
            names.add(name)
            waiting.extend(term.name for rule in derived.get(name, ()) for term in _terms(rule.body))
    return frozenset(names)


def _special(condition: Condition) -> bool:
    """Whether it speaks of ``?duration`` and the like, which the store does not know."""
    return any(isinstance(term, Special) for term in _terms(condition))


def _terms(part: "Condition | Numeric") -> List["Atom | Fluent | Special"]:
    if isinstance(part, (Atom, Fluent, Special)):
        return [part]
    if isinstance(part, Comparison):
        return _terms(part.left) + _terms(part.right)
    if isinstance(part, (And, Or, Arithmetic)):
        return [term for inner in part.parts for term in _terms(inner)]
    if isinstance(part, (Not, Forall, Exists, Preference)):
        return _terms(part.part)
    return []
