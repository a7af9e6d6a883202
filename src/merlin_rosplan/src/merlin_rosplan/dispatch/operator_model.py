# SPDX-License-Identifier: Apache-2.0
"""What parser and dispatcher look at of an operator: its conditions and effects, sorted by time."""

from dataclasses import dataclass, field
from typing import Dict, FrozenSet, Iterable, List, NamedTuple, Sequence, Set, Tuple

from merlin_pddl import formula
from merlin_pddl.domain import Operator, Rules, depends_on
from merlin_pddl.formula import END, OVER_ALL, START, Atom, Comparison, Condition, Effect, Equal, Fluent, Not
from merlin_pddl.knowledge import Key
from merlin_rosplan.dispatch.dispatch_schedule import BindingError


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
    """A numeric condition; operator variables before grounding, objects after it."""

    condition: Comparison

    @property
    def reads(self) -> Tuple[PlanTerm, ...]:
        """The function terms in it, without specials like ``?duration``."""
        return _fluents(self.condition)

    @property
    def functions(self) -> FrozenSet[str]:
        """Names of the functions it reads."""
        return frozenset(term.name.lower() for term in self.reads)


@dataclass(frozen=True)
class WatchedCondition:
    """A condition that is neither literal nor comparison.

    :param condition: the formula; operator variables before grounding, objects after it.
    :param reads: names of the predicates and functions that it depends on.
    """

    condition: Condition
    reads: FrozenSet[str] = frozenset()

    def ground(self, binding: Dict[str, str]) -> "WatchedCondition":
        """The operator's variables replaced."""
        return WatchedCondition(formula.ground(self.condition, binding), self.reads)

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
        if other.empty:
            return self
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
        """The operator's variables replaced."""
        if self.empty:
            return self
        return Conditions(
            _ground(self.positive, binding),
            _ground(self.negative, binding),
            tuple(Inequality(formula.ground(entry.condition, binding)) for entry in self.comparisons),
            tuple(entry.ground(binding) for entry in self.expressions),
        )

    @property
    def empty(self) -> bool:
        """Whether there is nothing to check."""
        return not (self.positive or self.negative or self.comparisons or self.expressions)

    def as_false(self) -> str:
        """Says that they are false, as part of a sentence."""
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
    """Effects of one time label; of numeric ones only which function terms they change and read.

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
        return TimedEffects(
            _ground(self.add, binding),
            _ground(self.delete, binding),
            _ground(self.writes, binding),
            _ground(self.reads, binding),
            _ground(self.additive, binding),
            self.wild,
            self.wild_reads,
        )


@dataclass(frozen=True)
class ActionModel:
    """What an operator needs and changes, and when; with objects for variables that of one action of a plan.

    A plain one (not `durative`) has its conditions in `at_start` and its effects in `start_effects`. They are
    applied when it ends.
    """

    name: str
    parameters: Tuple[str, ...]
    at_start: Conditions = field(default_factory=Conditions)
    over_all: Conditions = field(default_factory=Conditions)
    at_end: Conditions = field(default_factory=Conditions)
    start_effects: TimedEffects = field(default_factory=TimedEffects)
    end_effects: TimedEffects = field(default_factory=TimedEffects)
    durative: bool = True
    constraints: Tuple[FrozenSet[Key], ...] = ()
    """Those of its domain, :attr:`merlin_pddl.domain.Domain.constraints`."""

    @staticmethod
    def of(operator: Operator, derived: Rules, constraints: Tuple[FrozenSet[Key], ...] = ()) -> "ActionModel":
        """The model of an operator.

        :param derived: the rules of its domain. A derived fact changes when what it is derived from does: it
            is watched as an expression.
        :param constraints: what the trajectory constraints of its domain read.
        """

        def needed(when: str) -> Conditions:
            timed = [each.condition for each in operator.conditions if each.when == when]
            return _conditions([part for each in timed for part in formula.must_hold(each)], derived)

        return ActionModel(
            operator.name,
            tuple(parameter.name for parameter in operator.parameters),
            needed(START),
            needed(OVER_ALL),
            needed(END),
            _effects(operator.effects, START, derived),
            _effects(operator.effects, END, derived),
            operator.durative,
            constraints,
        )

    def bind(self, arguments: Sequence[str], duration: float = 0.0) -> Dict[str, str]:
        """Objects by parameter, from a plan's list of arguments, and the planned duration.

        :param duration: s; in messages 32 bits, of which seven digits are right.
        :raises BindingError: the number of arguments is not the number of parameters.
        """
        if len(arguments) != len(self.parameters):
            raise BindingError(
                f"{self.name} has {len(self.parameters)} parameters ({' '.join(self.labels) or 'none'}), "
                f"not {len(arguments)} ({' '.join(arguments) or 'none'})"
            )
        return {"?duration": f"{duration:.7g}", **dict(zip(self.parameters, arguments))}

    @property
    def labels(self) -> List[str]:
        """The parameters as messages name them."""
        return [parameter.lstrip("?") for parameter in self.parameters]

    def ground(self, binding: Dict[str, str]) -> "ActionModel":
        """The ground action; parameters without an object stay variables."""
        return ActionModel(
            self.name,
            tuple(binding.get(parameter, parameter) for parameter in self.parameters),
            self.at_start.ground(binding),
            self.over_all.ground(binding),
            self.at_end.ground(binding),
            self.start_effects.ground(binding),
            self.end_effects.ground(binding),
            self.durative,
            self.constraints,
        )


def over_all_before_start(action: ActionModel) -> Conditions:
    """The over-all conditions of a ground action that must hold already before it starts.

    Those its own start effects bring about do not: they hold from the start on, not before it.
    """
    effects = action.start_effects
    if effects.empty or action.over_all.empty:
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


def broken_by_own_end(action: ActionModel, atom: PlanTerm, negative: bool) -> bool:
    """Whether the end effects of a ground action make one of its own over-all conditions false."""
    effects = action.end_effects.add if negative else action.end_effects.delete
    return atom.key in {effect.key for effect in effects} or atom.name.lower() in action.end_effects.wild


def _ground(atoms: Iterable[PlanTerm], binding: Dict[str, str]) -> Tuple[PlanTerm, ...]:
    return tuple([atom.ground(binding) for atom in atoms])


def _fluents(part: formula.Formula) -> Tuple[PlanTerm, ...]:
    return tuple(PlanTerm(term.name, term.args) for term in formula.terms(part) if isinstance(term, Fluent))


def _conditions(parts: Iterable[Condition], derived: Rules) -> Conditions:
    positive: List[PlanTerm] = []
    negative: List[PlanTerm] = []
    comparisons: List[Inequality] = []
    expressions: List[WatchedCondition] = []
    for part in parts:
        inner = part.part if isinstance(part, Not) else part
        if isinstance(inner, Equal):
            inner = Atom("=", (inner.left, inner.right))
        if isinstance(inner, Atom) and inner.name not in derived:
            (negative if isinstance(part, Not) else positive).append(PlanTerm(inner.name, inner.args))
        elif isinstance(part, Comparison):
            comparisons.append(Inequality(part))
        else:
            expressions.append(WatchedCondition(part, depends_on(part, derived)))
    return Conditions(tuple(positive), tuple(negative), tuple(comparisons), tuple(expressions))


def _effects(effects: Iterable[Effect], when: str, derived: Rules) -> TimedEffects:
    """The effects at one time. A continuous one is applied at the end, with all the time that has passed."""
    lists: Dict[str, List[PlanTerm]] = {key: [] for key in ("add", "delete", "writes", "reads", "additive")}
    wild: Set[str] = set()
    wild_reads: Set[str] = set()
    for effect in effects:
        now = (effect.when == START) == (when == START)
        target, value = effect.atom or effect.fluent, effect.value
        assert target is not None
        for timed in effect.conditions:
            if (timed.when == START) == (when == START):
                wild_reads |= depends_on(timed.condition, derived)
        if not now:
            continue
        if effect.variables or effect.conditions or effect.when == OVER_ALL:
            wild.add(target.name)
            wild_reads.update(term.name for term in (formula.terms(value) if value is not None else ()))
            continue
        term = PlanTerm(target.name, target.args)
        if value is None:
            lists["delete" if effect.negative else "add"].append(term)
            continue
        lists["writes"].append(term)
        lists["reads"] += _fluents(value)
        if effect.op in ("increase", "decrease"):
            lists["additive"].append(term)
    groups = {key: tuple(found) for key, found in lists.items()}
    return TimedEffects(**groups, wild=frozenset(wild), wild_reads=frozenset(wild_reads))
