"""Operators for parser and dispatcher: conditions and effects sorted by time, ready to be grounded.

:class:`merlin_pddl.domain.Operator` is what a domain says; these are what any ROSPlan knowledge base answers.
They are read from ``rosplan_knowledge_msgs/DomainOperator`` by attribute, so nothing here needs ROS. What
that message cannot carry (disjunctions, quantifiers, derived predicates) comes from
:mod:`merlin_rosplan.messages.operator_expressions`.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Dict, FrozenSet, Iterable, NamedTuple, Sequence, Set, Tuple

from merlin_pddl import formula


class PlanTerm(NamedTuple):
    """A predicate or function with arguments: variables of an operator before grounding, objects after it."""

    name: str
    arguments: Tuple[str, ...] = ()

    def ground(self, binding: Dict[str, str]) -> "PlanTerm":
        """Variables replaced; what is not a variable is a constant and stands for itself."""
        return PlanTerm(self.name, tuple([binding.get(argument, argument) for argument in self.arguments]))

    @property
    def key(self) -> "PlanTerm":
        """The atom for comparing: names in PDDL do not depend on case."""
        lower = PlanTerm(self.name.lower(), tuple([argument.lower() for argument in self.arguments]))
        return self if lower == self else lower  # most are: one shared object

    def __str__(self) -> str:
        return "(" + " ".join((self.name,) + self.arguments) + ")"


@dataclass(frozen=True)
class Inequality:
    """A numeric condition.

    :param message: the DomainInequality it came from, not grounded.
    :param reads: function terms in it.
    """

    message: Any
    reads: Tuple[PlanTerm, ...] = ()

    @property
    def functions(self) -> FrozenSet[str]:
        """Names of the functions it reads."""
        return frozenset(term.name.lower() for term in self.reads)


@dataclass(frozen=True)
class WatchedCondition:
    """A condition that is neither literal nor comparison.

    :param condition: it; operator variables before grounding, objects after it.
    :param reads: names of the predicates and functions that it depends on.
    """

    condition: formula.Condition
    reads: FrozenSet[str] = frozenset()

    def ground(self, binding: Dict[str, str]) -> "WatchedCondition":
        """TimedOperator variables replaced."""
        bindings = {f"?{name}": value for name, value in binding.items()}
        return WatchedCondition(formula.ground(self.condition, bindings), self.reads)

    def __str__(self) -> str:
        return formula.to_pddl(self.condition)


@dataclass(frozen=True)
class Conditions:
    """Conditions of one time label."""

    positive: Tuple[PlanTerm, ...] = ()
    negative: Tuple[PlanTerm, ...] = ()
    comparisons: Tuple[Inequality, ...] = ()
    expressions: Tuple[WatchedCondition, ...] = ()

    def __add__(self, other: "Conditions") -> "Conditions":
        return Conditions(
            self.positive + other.positive,
            self.negative + other.negative,
            self.comparisons + other.comparisons,
            self.expressions + other.expressions,
        )

    def __sub__(self, other: "Conditions") -> "Conditions":
        return Conditions(
            tuple(atom for atom in self.positive if atom not in other.positive),
            tuple(atom for atom in self.negative if atom not in other.negative),
            tuple(entry for entry in self.comparisons if entry not in other.comparisons),
            tuple(entry for entry in self.expressions if entry not in other.expressions),
        )

    @property
    def names(self) -> FrozenSet[str]:
        """Predicates and functions that they depend on."""
        return frozenset(atom.name.lower() for atom in self.positive + self.negative).union(
            *(entry.functions for entry in self.comparisons), *(entry.reads for entry in self.expressions)
        )

    def ground(self, binding: Dict[str, str]) -> "Conditions":
        """Atoms and terms grounded; a comparison's message is grounded when it is asked."""
        return Conditions(
            _ground(self.positive, binding),
            _ground(self.negative, binding),
            tuple(Inequality(entry.message, _ground(entry.reads, binding)) for entry in self.comparisons),
            tuple(entry.ground(binding) for entry in self.expressions),
        )

    @property
    def empty(self) -> bool:
        """Whether there is nothing to check."""
        return not (self.positive or self.negative or self.comparisons or self.expressions)

    def as_false(self) -> str:
        """That they are false, as part of a sentence."""
        parts = [f"{atom} does not hold" for atom in self.positive]
        parts += [f"{atom} holds" for atom in self.negative]
        parts += [
            f"a comparison of {', '.join(sorted(entry.functions)) or 'numbers'} is false"
            for entry in self.comparisons
        ]
        parts += [f"{entry} does not hold" for entry in self.expressions]
        return ", ".join(parts)


@dataclass(frozen=True)
class TimedEffects:
    """TimedEffects of one time label; of numeric ones only which function terms they change and read.

    :param additive: those of `writes` that are only increased or decreased; such changes commute.
    :param wild, wild_reads: names that conditional, quantified and continuous effects change and read.
    """

    add: Tuple[PlanTerm, ...] = ()
    delete: Tuple[PlanTerm, ...] = ()
    writes: Tuple[PlanTerm, ...] = ()
    reads: Tuple[PlanTerm, ...] = ()
    additive: Tuple[PlanTerm, ...] = ()
    wild: FrozenSet[str] = frozenset()
    wild_reads: FrozenSet[str] = frozenset()

    @property
    def functions(self) -> FrozenSet[str]:
        """Names of the functions they change."""
        return frozenset(term.name.lower() for term in self.writes)

    @property
    def names(self) -> FrozenSet[str]:
        """Names of the predicates and functions they change."""
        return self.functions.union(self.wild, (atom.name.lower() for atom in self.add + self.delete))

    @property
    def empty(self) -> bool:
        """Whether nothing changes."""
        return not (self.add or self.delete or self.writes or self.wild)

    def ground(self, binding: Dict[str, str]) -> "TimedEffects":
        """Atoms and terms grounded."""
        return replace(
            self,
            add=_ground(self.add, binding),
            delete=_ground(self.delete, binding),
            writes=_ground(self.writes, binding),
            reads=_ground(self.reads, binding),
            additive=_ground(self.additive, binding),
        )


class BindingError(ValueError):
    """Arguments that do not fit an operator; the text says how."""


@dataclass(frozen=True)
class TimedOperator:
    """An operator, or with objects for variables one of its ground actions.

    A plain one (not `durative`) has its conditions in `at_start` and its effects in `start_effects`, as the
    messages carry them. They are applied when it ends.
    """

    name: str
    parameters: Tuple[str, ...]
    at_start: Conditions = field(default_factory=Conditions)
    over_all: Conditions = field(default_factory=Conditions)
    at_end: Conditions = field(default_factory=Conditions)
    start_effects: TimedEffects = field(default_factory=TimedEffects)
    end_effects: TimedEffects = field(default_factory=TimedEffects)
    durative: bool = True

    @staticmethod
    def from_message(message: Any) -> "TimedOperator":
        """Reads a DomainOperator.

        The message does not say whether it is durative: one with nothing over all and at its end counts as
        plain, as it does for the action interfaces.
        """
        found = TimedOperator(
            message.formula.name,
            tuple(parameter.key for parameter in message.formula.typed_parameters),
            _conditions(
                message.at_start_simple_condition, message.at_start_neg_condition, message.at_start_comparison
            ),
            _conditions(
                message.over_all_simple_condition, message.over_all_neg_condition, message.over_all_comparison
            ),
            _conditions(
                message.at_end_simple_condition, message.at_end_neg_condition, message.at_end_comparison
            ),
            _effects(
                message.at_start_add_effects, message.at_start_del_effects, message.at_start_assign_effects
            ),
            _effects(message.at_end_add_effects, message.at_end_del_effects, message.at_end_assign_effects),
        )
        plain = found.over_all.empty and found.at_end.empty and found.end_effects.empty
        return replace(found, durative=not plain)

    def bind(self, arguments: Sequence[str]) -> Dict[str, str]:
        """Objects by parameter, from a plan's list of arguments.

        :raises BindingError: the number of arguments is not the number of parameters.
        """
        if len(arguments) != len(self.parameters):
            raise BindingError(
                f"{self.name} has {len(self.parameters)} parameters ({' '.join(self.parameters) or 'none'}), "
                f"not {len(arguments)} ({' '.join(arguments) or 'none'})"
            )
        return dict(zip(self.parameters, arguments))

    def ground(self, binding: Dict[str, str]) -> "TimedOperator":
        """The ground action; parameters without an object stay variables."""
        return TimedOperator(
            self.name,
            tuple(binding.get(parameter, parameter) for parameter in self.parameters),
            self.at_start.ground(binding),
            self.over_all.ground(binding),
            self.at_end.ground(binding),
            self.start_effects.ground(binding),
            self.end_effects.ground(binding),
            self.durative,
        )


def over_all_before_start(action: TimedOperator) -> Conditions:
    """The over-all conditions of a ground action that must hold already before it starts.

    Those its own start effects bring about do not: they hold from the start on, not before it.
    """
    effects = action.start_effects
    if effects.empty:
        return action.over_all
    added = {atom.key for atom in effects.add}
    deleted = {atom.key for atom in effects.delete}

    def own(atom: PlanTerm, made: Set[PlanTerm]) -> bool:
        return atom.key in made or atom.name.lower() in effects.wild

    return Conditions(
        tuple(atom for atom in action.over_all.positive if not own(atom, added)),
        tuple(atom for atom in action.over_all.negative if not own(atom, deleted)),
        tuple(entry for entry in action.over_all.comparisons if not entry.functions & effects.names),
        tuple(entry for entry in action.over_all.expressions if not entry.reads & effects.names),
    )


def broken_by_own_end(action: TimedOperator, atom: PlanTerm, negative: bool) -> bool:
    """Whether the end effects of a ground action make one of its own over-all conditions false."""
    effects = action.end_effects.add if negative else action.end_effects.delete
    return atom.key in {effect.key for effect in effects} or atom.name.lower() in action.end_effects.wild


def _atom(formula: Any) -> PlanTerm:
    return PlanTerm(formula.name, tuple(parameter.key for parameter in formula.typed_parameters))


def _atoms(formulas: Iterable[Any]) -> Tuple[PlanTerm, ...]:
    return tuple(_atom(formula) for formula in formulas)


def _ground(atoms: Iterable[PlanTerm], binding: Dict[str, str]) -> Tuple[PlanTerm, ...]:
    return tuple(atom.ground(binding) for atom in atoms)


def _terms(*expressions: Any) -> Tuple[PlanTerm, ...]:
    return tuple(
        _atom(token.function)
        for expression in expressions
        for token in expression.tokens
        if token.expr_type == token.FUNCTION
    )


def _conditions(positive: Iterable[Any], negative: Iterable[Any], comparisons: Iterable[Any]) -> Conditions:
    return Conditions(
        _atoms(positive),
        _atoms(negative),
        tuple(Inequality(entry, _terms(entry.LHS, entry.RHS)) for entry in comparisons),
    )


def _effects(add: Iterable[Any], delete: Iterable[Any], assign: Iterable[Any]) -> TimedEffects:
    assign = list(assign)
    return TimedEffects(
        _atoms(add),
        _atoms(delete),
        tuple(_atom(entry.LHS) for entry in assign),
        tuple(term for entry in assign for term in _terms(entry.RHS)),
        tuple(_atom(entry.LHS) for entry in assign if entry.assign_type in (entry.INCREASE, entry.DECREASE)),
    )
