# SPDX-License-Identifier: Apache-2.0
"""What the rest of a plan needs of the world as it is. Pure: nothing is asked here."""

from typing import (
    AbstractSet,
    Dict,
    FrozenSet,
    Iterable,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
)

from merlin_rosplan.dispatch.operator_model import (
    ActionModel,
    Conditions,
    PlanTerm,
    TimedEffects,
    over_all_before_start,
)
from merlin_rosplan.dispatch.plan_graph_history import constrained

GOAL = -1  #: Stands for the goals where an action id is expected.


class Need(NamedTuple):
    """One literal, comparison or expression that a step needs, or that is a goal."""

    step: int
    """The action id, or :data:`GOAL`."""
    condition: Conditions
    at_end: bool = False
    """Whether it is an at-end condition."""

    @property
    def names(self) -> FrozenSet[str]:
        """Predicates and functions that it depends on."""
        return self.condition.names


class Needs(NamedTuple):
    """What the rest of a plan needs."""

    of_now: List[Need]
    """What no step before it changes: the world has to be so now. In the order of the plan."""
    broken: List[Need]
    """What a step before it makes false."""
    unjudged: Set[str]
    """Names that matter in a way that is not followed, as in the condition of a conditional effect."""


class PlanRest:
    """The happenings of a plan: what each needs, and what it changes.

    Facts are followed through the plan. A numeric, quantified, disjunctive or derived condition is judged
    where no earlier step of the rest changes what it reads, and a fact where none may change it
    conditionally. The end of an action that runs is not judged: what is needed then its machine may bring
    about.

    :param order: the start (False) and the end (True) of each action, in the order of the plan.
    :param models: the ground actions by id.
    """

    def __init__(self, order: Sequence[Tuple[int, bool]], models: Mapping[int, ActionModel]) -> None:
        self._order = order
        self._models = models
        self._needed: Dict[Tuple[int, bool], List[Need]] = {}

    def effects(self, action_id: int) -> Set[Tuple[PlanTerm, bool]]:
        """Every fact that an action makes true or false without a condition."""
        model = self._models[action_id]
        return set(_facts(model.start_effects)) | set(_facts(model.end_effects))

    def changes(self, action_id: int) -> FrozenSet[str]:
        """The predicates and functions that an action changes."""
        model = self._models[action_id]
        return model.start_effects.names | model.end_effects.names

    def constrained(self, action_id: int) -> bool:
        """Whether an action changes what a trajectory constraint reads: the constraint may need it."""
        model = self._models[action_id]
        effects = (model.start_effects, model.end_effects)
        return any(constrained(reads, each) for reads in model.constraints for each in effects)

    @property
    def reads(self) -> FrozenSet[str]:
        """The predicates and functions that conditions of the plan depend on."""
        return frozenset(
            name
            for each in self._models.values()
            for name in (each.at_start + each.over_all + each.at_end).names
        )

    def needed_facts(self, action_id: int) -> Set[Tuple[PlanTerm, bool]]:
        """The facts that an action needs, at whatever time, and whether each has to hold."""
        needs = self._needs_of(action_id, False) + self._needs_of(action_id, True)
        return {literal for literal in (literal_of(need.condition) for need in needs) if literal}

    def arguments(self, action_id: int) -> Tuple[str, ...]:
        """The objects of an action."""
        return self._models[action_id].parameters

    def needs(
        self, running: Mapping[int, bool], left_out: AbstractSet[int], goals: Optional[Conditions] = None
    ) -> Needs:
        """What the rest needs.

        :param running: the actions that run, each with whether its start effects have come true. All other
            effects of theirs are coming.
        :param left_out: the actions that have ended, and those that are skipped.
        :param goals: what has to hold at the end.
        """
        book = _Book()
        for action_id, at_end in self._order:
            if action_id in left_out:
                continue
            model = self._models[action_id]
            begun = running.get(action_id)
            if begun is None:
                book.need(self._needs_of(action_id, at_end))
            if at_end:
                book.write(model.end_effects)
            elif not (begun and model.durative):  # the effects of a plain one come at its end
                book.write(model.start_effects)
        if goals is not None:
            book.need(_each(GOAL, goals))
        return book.needs

    def _needs_of(self, action_id: int, at_end: bool) -> List[Need]:
        found = self._needed.get((action_id, at_end))
        if found is None:
            model = self._models[action_id]
            first = model.at_start + over_all_before_start(model)
            found = _each(action_id, model.over_all if at_end else first)
            if at_end:
                found += [need._replace(at_end=True) for need in _each(action_id, model.at_end)]
            self._needed[action_id, at_end] = found
        return found


class _Book:
    """What is found on the way through a plan."""

    def __init__(self) -> None:
        self.needs = Needs([], [], set())
        self._written: Dict[PlanTerm, bool] = {}
        self._touched: Set[str] = set()  # predicates of these
        self._unknown: Set[str] = set()  # names whose new value is not known
        self._seen: Set[Conditions] = set()

    def need(self, needs: Iterable[Need]) -> None:
        for need in needs:
            literal = literal_of(need.condition)
            if literal is None or literal[0].name in self._unknown:
                unknown = need.names & (self._unknown if literal else self._unknown | self._touched)
                if unknown:
                    self.needs.unjudged.update(need.names)
                    continue
            elif literal[0] in self._written:
                if self._written[literal[0]] != literal[1]:
                    self.needs.broken.append(need)
                continue
            if need.condition not in self._seen:
                self._seen.add(need.condition)
                self.needs.of_now.append(need)

    def write(self, effects: TimedEffects) -> None:
        for term, holds in _facts(effects):
            self._written[term] = holds
            self._touched.add(term.name)
        self._unknown.update(effects.functions, (name.lower() for name in effects.wild))
        self.needs.unjudged.update(effects.wild_reads, (term.name.lower() for term in effects.reads))


def literal_of(condition: Conditions) -> Optional[Tuple[PlanTerm, bool]]:
    """The fact that a single condition is about, and whether it has to hold; None for other conditions."""
    if condition.positive:
        return condition.positive[0].key, True
    if condition.negative:
        return condition.negative[0].key, False
    return None


def _facts(effects: TimedEffects) -> List[Tuple[PlanTerm, bool]]:
    """Deletions come first: what is deleted and added is added."""
    added = {atom.key for atom in effects.add}
    deleted = [(atom.key, False) for atom in effects.delete if atom.key not in added]
    return deleted + [(atom, True) for atom in added]


def _each(step: int, conditions: Conditions) -> List[Need]:
    """The single conditions, without equalities."""
    singles = [Conditions(positive=(atom,)) for atom in conditions.positive if atom.name != "="]
    singles += [Conditions(negative=(atom,)) for atom in conditions.negative if atom.name != "="]
    singles += [Conditions(comparisons=(entry,)) for entry in conditions.comparisons]
    singles += [Conditions(expressions=(entry,)) for entry in conditions.expressions]
    return [Need(step, single) for single in singles]
