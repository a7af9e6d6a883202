# SPDX-License-Identifier: Apache-2.0
"""What a strict knowledge base refuses, with the reason; what it accepts gets the domain's spelling."""

import math
from typing import Dict, Optional, Set, Tuple

from merlin_pddl.domain import Signature
from merlin_pddl.formula import (
    And,
    Arithmetic,
    Atom,
    Comparison,
    Condition,
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
    preferences,
    to_pddl,
    violated,
)
from merlin_pddl.formula_reader import SPECIALS
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Metric, StoredGoal
from merlin_pddl.problem_reader import parse_condition
from merlin_pddl.text_reader import PddlError, is_name, shortened, suggestion
from merlin_pddl.type_hierarchy import OBJECT
from merlin_rosplan.knowledge.knowledge_state import KnowledgeTables


class UpdateRefused(Exception):
    """An update is refused; the text says why, shortened when a client sent names without end."""

    def __init__(self, reason: str) -> None:
        super().__init__(shortened(reason))


class KnowledgeChecks:
    """Checks updates against a domain and the objects that exist: what passes, the planner can read.

    :param state: knows the domain and the objects.
    """

    def __init__(self, state: KnowledgeTables) -> None:
        self._state = state
        self._domain = state.domain

    def instance(self, item: Instance) -> Instance:
        """An instance that may be added.

        :raises UpdateRefused: its type is unknown, or its name empty or not a name in PDDL.
        """
        kind = item.type_name.lower()
        if kind not in self._domain.types:
            hint = suggestion(kind, self._domain.types)
            raise UpdateRefused(f"unknown type '{item.type_name}' of the instance '{item.name}'{hint}")
        if not item.name:
            raise UpdateRefused(f"the name of the new {kind} is empty")
        if not is_name(item.name):
            raise UpdateRefused(
                f"'{item.name}' is not a name in PDDL: a letter first, then letters, digits, '-' and '_'"
            )
        return Instance(kind, self._state.spelling(item.name) or item.name)

    def fact(self, item: Fact) -> Fact:
        """A fact that may be added.

        :raises UpdateRefused: predicate or object is unknown, the predicate is derived, or the arguments are
            too many, too few, empty or of another type.
        """
        atom = self._atom(item.name, item.args)
        if atom.name in self._domain.derived:
            raise UpdateRefused(f"'{atom.name}' is derived: it follows from other facts and is not stated")
        return Fact(atom.name, atom.args, item.negative, item.since)

    def _atom(self, name: str, args: Tuple[str, ...]) -> Atom:
        signature = self._signature(name, self._domain.predicates, "predicate")
        return Atom(signature.name, self._arguments(signature, args))

    def value(self, item: FunctionValue) -> FunctionValue:
        """A function value that may be added.

        :raises UpdateRefused: as for a fact, or the value is not a finite number.
        """
        signature = self._signature(item.name, self._domain.functions, "function")
        args = self._arguments(signature, item.args)
        if not math.isfinite(item.value):
            raise UpdateRefused(f"the value of {item.text()} is {item.value}, no finite number")
        return FunctionValue(signature.name, args, item.value, item.since, item.op)

    def goal(self, item: StoredGoal) -> StoredGoal:
        """A goal that may be added.

        :raises UpdateRefused: it names something unknown.
        """
        if item.instance is not None:
            return StoredGoal(None, self.instance(item.instance), item.since)
        assert item.condition is not None
        return StoredGoal(self._condition(item.condition), None, item.since)

    def check_again(self, goal: StoredGoal) -> None:
        """Checks a stored goal against the objects that are left.

        :raises UpdateRefused: it can no longer be read.
        """
        try:
            if goal.condition is not None:
                parse_condition(goal.text(), self._domain, self._state.all_objects())
        except PddlError as error:
            remedy = "remove it before, or in the same array"
            raise UpdateRefused(
                f"the goal {goal.text()} is still there: {error.message}; {remedy}"
            ) from error

    def metric(self, item: Metric) -> Metric:
        """A metric that may be set.

        :raises UpdateRefused: it names something unknown.
        """
        if item.optimization.lower() not in ("minimize", "maximize"):
            raise UpdateRefused(f"a metric is to 'minimize' or 'maximize', not to '{item.optimization}'")
        value = self._numeric(item.value, ("total-time", "is-violated"))
        if self.unknown(item):
            raise UpdateRefused(f"there is no preference '{min(self.unknown(item))}' that could be violated")
        return Metric(item.optimization.lower(), value)

    def unknown(self, metric: Metric) -> Set[str]:
        """The preferences of a metric that neither the domain nor a goal has."""
        named = {p.name for goal in self._state.goals.all() for p in preferences(goal.condition or And())}
        return violated(metric.value) - named - self._domain.preferences

    def _signature(self, name: str, known: Dict[str, Signature], what: str) -> Signature:
        if not name:
            raise UpdateRefused(f"the name of the {what} is empty")
        found = known.get(name.lower())
        if found is None:
            raise UpdateRefused(f"unknown {what} '{name}'{suggestion(name.lower(), known)}")
        return found

    def _arguments(self, signature: Signature, args: Tuple[str, ...]) -> Tuple[str, ...]:
        wanted = signature.parameters
        if len(args) != len(wanted):
            raise UpdateRefused(f"'{signature.name}' takes {len(wanted)} argument(s), here are {len(args)}")
        found = []
        for arg, parameter in zip(args, wanted):
            if not arg:
                constant: Optional[str] = self._domain.only_constant(parameter.types)
                if constant is None:
                    raise UpdateRefused(f"the argument '{parameter.label}' of '{signature.name}' is empty")
                arg = constant
            spelled = self._state.spelling(arg)
            if spelled is None:
                hint = suggestion(arg.lower(), self._state.objects(parameter.types)[:1000])
                raise UpdateRefused(f"unknown object '{arg}' in '{signature.name}'{hint}")
            if not self._fits(spelled.lower(), parameter.types):
                raise UpdateRefused(
                    f"'{spelled}' is of type {' and '.join(self._state.object_types(spelled))}, but "
                    f"'{signature.name}' takes {' or '.join(parameter.types)} for '{parameter.label}'"
                )
            found.append(spelled)
        return tuple(found)

    def _fits(self, name: str, types: Tuple[str, ...]) -> bool:
        if any(kind == OBJECT or (kind, name) in self._state.instances.rows for kind in types):
            return True
        return self._domain.accepts(types, tuple(kind.lower() for kind in self._state.object_types(name)))

    def _condition(self, condition: Condition) -> Condition:
        if isinstance(condition, Atom):
            return self._atom(condition.name, condition.args)
        if isinstance(condition, Comparison):
            return Comparison(condition.op, self._numeric(condition.left), self._numeric(condition.right))
        if isinstance(condition, Not):
            if preferences(condition.part):
                raise UpdateRefused(f"a preference cannot be negated: {to_pddl(condition)}")
            return Not(self._condition(condition.part))
        # the others come from text, which was read against the domain already
        assert isinstance(condition, (And, Or, Equal, Forall, Exists, Preference)), to_pddl(condition)
        return condition

    def _numeric(self, value: Numeric, specials: Tuple[str, ...] = ()) -> Numeric:
        if isinstance(value, Fluent):
            signature = self._signature(value.name, self._domain.functions, "function")
            return Fluent(signature.name, self._arguments(signature, value.args))
        if isinstance(value, Arithmetic):
            return Arithmetic(value.op, tuple(self._numeric(part, specials) for part in value.parts))
        if isinstance(value, Number) and not math.isfinite(value.value):
            raise UpdateRefused(f"{value.value} is not a finite number")
        if isinstance(value, Special) and value.name not in specials:
            raise UpdateRefused(f"'{value.name}' can only stand {SPECIALS[value.name]}")
        return value
