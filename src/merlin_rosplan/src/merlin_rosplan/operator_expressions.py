"""The conditions of an operator that a DomainOperator message cannot carry, from the domain itself.

Disjunctions, quantifiers, numeric equality and derived predicates: whoever has the domain checks them too;
parser and dispatcher take it from the knowledge base in their process, or from its file.
"""

import dataclasses
from typing import FrozenSet, List, Mapping, Set

from merlin_rosplan.domain import Derived, Domain
from merlin_rosplan.domain_messages import literals
from merlin_rosplan.formula import (
    END,
    OVER_ALL,
    START,
    And,
    Arithmetic,
    Atom,
    Comparison,
    Condition,
    Exists,
    Fluent,
    Forall,
    Not,
    Numeric,
    Or,
    Preference,
    Special,
)
from merlin_rosplan.operator_model import Conditions, Expression, Operator


def with_expressions(operator: Operator, domain: Domain) -> Operator:
    """An operator that was read from a message, with the rest of its conditions.

    Parameters
    ----------
    operator: not grounded.
    domain: it is one of this domain's.
    """
    conditions = domain.operators[operator.name.lower()].conditions

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
                Expression(part, _names(part, domain.derived)) for part in found if not _special(part)
            ),
        )

    return dataclasses.replace(
        operator,
        at_start=complete(operator.at_start, START),
        over_all=complete(operator.over_all, OVER_ALL),
        at_end=complete(operator.at_end, END),
    )


def _rest(condition: Condition, domain: Domain) -> List[Condition]:
    """The conjuncts that are no list of literals, and the derived ones among the literals."""
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
