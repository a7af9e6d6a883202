# SPDX-License-Identifier: Apache-2.0
"""Reads the trajectory constraints of PDDL 3: what has to hold on the way, not only at its end."""

from typing import Dict, FrozenSet, List, Optional, Set

from merlin_pddl.domain import Domain, depends_on
from merlin_pddl.formula import Atom, Condition, Exists, Fluent, Forall, terms, walk
from merlin_pddl.formula_reader import (
    TRAJECTORY,
    FormulaReader,
    Scope,
    number_of,
    parameters,
    preference_name,
)
from merlin_pddl.knowledge import Key
from merlin_pddl.text_reader import Expression, Node

#: constraint → how many numbers and how many conditions follow it
FORMS: Dict[str, List[int]] = {
    "always": [0, 1],
    "sometime": [0, 1],
    "at-most-once": [0, 1],
    "sometime-after": [0, 2],
    "sometime-before": [0, 2],
    "within": [1, 1],
    "hold-after": [1, 1],
    "hold-during": [2, 1],
    "always-within": [1, 2],
}
assert set(FORMS) == TRAJECTORY


class ConstraintReader:
    """Checks constraints over a domain.

    :param domain: knows the predicates, functions and constants.
    :param formulas: reads the conditions.
    :ivar reads: what each constraint that was read depends on, as in :class:`Domain`.
    :ivar timed: those with times, likewise.
    """

    def __init__(self, domain: Domain, formulas: FormulaReader) -> None:
        self._domain = domain
        self._formulas = formulas
        self.reads: List[FrozenSet[Key]] = []
        self.timed: List[str] = []

    def read(self, node: Node) -> str:
        """The constraint as PDDL on one line.

        :raises PddlError: it is malformed or names something unknown.
        """
        self._check(node, {})
        assert isinstance(node, Expression)
        return node.text()

    def _check(self, node: Node, scope: Scope) -> None:
        if not isinstance(node, Expression):
            raise node.error(f"expected a constraint in parentheses, found '{node}'")
        head = node.head
        if head == "and":
            for part in node[1:]:
                self._check(part, scope)
        elif head == "forall" and len(node) == 3:
            declared = parameters(node[1], self._domain, "'forall'")
            self._check(node[2], {**scope, **{v.name: v.types for v in declared}})
        elif head == "preference":
            preference_name(node)
            self._check(node[-1], scope)
        elif head == "at" and len(node) == 3 and node[1] == "end":
            found = self._keys(self._formulas.condition(node[2], scope), scope)
            self.reads += [frozenset({key}) for key in found]  # each is as its last change leaves it
        elif head in FORMS:
            self._form(node, scope)
        else:
            known = ", ".join(sorted(FORMS))
            raise node.error(f"expected a constraint ({known}, at end, and, forall, preference)")

    def _form(self, node: Expression, scope: Scope) -> None:
        numbers, conditions = FORMS[node.head]
        if len(node) != 1 + numbers + conditions:
            wanted = f"{numbers} number(s) and " if numbers else ""
            raise node.error(f"'{node.head}' takes {wanted}{conditions} condition(s)")
        for part in node[1 : 1 + numbers]:
            value = number_of(part)
            if value is None or value < 0:
                raise part.error(f"'{node.head}' takes a time in s here")
        if numbers:
            self.timed.append(node.text())
        parts = [self._formulas.condition(part, scope) for part in node[1 + numbers :]]
        self.reads.append(frozenset(key for part in parts for key in self._keys(part, scope)))

    def _keys(self, condition: Condition, scope: Scope) -> Set[Key]:
        quantified = (part for part in walk(condition) if isinstance(part, (Forall, Exists)))
        own = scope.keys() - {variable.name for part in quantified for variable in part.variables}
        found: Set[Key] = set()
        for term in terms(condition):
            if isinstance(term, Atom) and term.name in self._domain.derived:
                found |= {(name,) for name in depends_on(term, self._domain.derived)}
            elif isinstance(term, (Atom, Fluent)):
                args = ("" if arg.startswith("?") and arg not in own else arg for arg in term.args)
                found.add((term.name, *args))
        return found


def misplaced(node: Node) -> Optional[Expression]:
    """The first trajectory constraint below an expression, if there is one."""
    if not isinstance(node, Expression):
        return None
    if node.head in TRAJECTORY:
        return node
    return next((found for found in map(misplaced, node) if found is not None), None)
