# SPDX-License-Identifier: Apache-2.0
"""What the start or the end of an action needs and changes: a happening of PDDL 2.1."""

from typing import FrozenSet, NamedTuple, Sequence

from merlin_rosplan.dispatch.operator_model import (
    ActionModel,
    Conditions,
    PlanTerm,
    TimedEffects,
    over_all_before_start,
)
from merlin_rosplan.dispatch.plan_graph import NodeType


class Happening(NamedTuple):
    """What one node needs and changes.

    The conditions at a start are checked before it, those over all are watched. What else a happening reads
    is not looked at when a plan is carried out: it is `unchecked`, only its place in the order keeps it so.
    """

    positive: Sequence[PlanTerm] = ()
    negative: Sequence[PlanTerm] = ()
    add: Sequence[PlanTerm] = ()
    delete: Sequence[PlanTerm] = ()
    # protected until this node, besides what it needs itself: the over-all conditions at an action's end
    keep_positive: Sequence[PlanTerm] = ()
    keep_negative: Sequence[PlanTerm] = ()
    reads: Sequence[PlanTerm] = ()  # function values
    writes: Sequence[PlanTerm] = ()
    additive: Sequence[PlanTerm] = ()  # those of `writes` that commute with other additive ones
    depends: FrozenSet[str] = frozenset()  # names that are read, whatever their arguments
    changes: FrozenSet[str] = frozenset()  # names that change
    wild: FrozenSet[str] = frozenset()  # those of them of which it is not known with which arguments
    unchecked: FrozenSet[PlanTerm] = frozenset()
    unchecked_names: FrozenSet[str] = frozenset()


def _keys(*groups: Sequence[PlanTerm]) -> Sequence[PlanTerm]:
    if not any(groups):
        return ()
    return tuple(dict.fromkeys([atom.key for group in groups for atom in group]))


def happening_of(action: ActionModel, type_: NodeType) -> Happening:
    """The happening at the start or the end of a ground action.

    A plain action is one happening in a plan and takes its time when it is carried out: its conditions are
    checked at its start, must last until its end, and its effects, with all that they read, belong there.
    """
    nothing = Conditions()
    if type_ == NodeType.ACTION_START:
        if not action.durative:
            read = TimedEffects(reads=action.start_effects.reads, wild_reads=action.start_effects.wild_reads)
            return _happening(action.at_start, nothing, read, nothing)
        found = _happening(action.at_start + action.over_all, nothing, action.start_effects, nothing)
        before = action.at_start + over_all_before_start(action)
        return found._replace(positive=_keys(before.positive), negative=_keys(before.negative))
    if not action.durative:
        return _happening(nothing, action.at_start, action.start_effects, action.at_start)
    return _happening(action.at_end, action.over_all, action.end_effects, action.at_end)


def rosplan_happening(action: ActionModel, type_: NodeType) -> Happening:
    """The happening as ROSPlan's own parser takes it: facts only.

    The effects of a plain action are at its start, and conditions over all count at the start alone.
    """
    needs, effects = action.at_start + action.over_all, action.start_effects
    if type_ == NodeType.ACTION_END:
        needs, effects = action.at_end, action.end_effects
    return Happening(_keys(needs.positive), _keys(needs.negative), _keys(effects.add), _keys(effects.delete))


def _happening(
    needs: Conditions, keeps: Conditions, effects: TimedEffects, unchecked: Conditions
) -> Happening:
    compared = [entry.reads for entry in needs.comparisons + keeps.comparisons]
    open_reads = [entry.reads for entry in unchecked.comparisons]
    return Happening(
        _keys(needs.positive),
        _keys(needs.negative),
        _keys(effects.add),
        _keys(effects.delete),
        _keys(keeps.positive),
        _keys(keeps.negative),
        _keys(*compared, effects.reads),
        _keys(effects.writes),
        _additive(effects),
        expression_names(needs, keeps) | effects.wild_reads,
        effects.names,
        effects.wild,
        frozenset(_keys(unchecked.positive, unchecked.negative, *open_reads, effects.reads)),
        expression_names(unchecked) | effects.wild_reads,
    )


def _additive(effects: TimedEffects) -> Sequence[PlanTerm]:
    """Terms that are only increased and decreased, and not assigned besides."""
    if not effects.additive:
        return ()
    writes, additive = ([atom.key for atom in atoms] for atoms in (effects.writes, effects.additive))
    return [term for term in dict.fromkeys(additive) if writes.count(term) == additive.count(term)]


def expression_names(*conditions: Conditions) -> FrozenSet[str]:
    """Predicates and functions that the expressions of some conditions read."""
    return frozenset().union(*(entry.reads for each in conditions for entry in each.expressions))


def names_by_argument(happening: Happening) -> FrozenSet[str]:
    """Names of the atoms and function terms that a happening needs or keeps."""
    groups = (
        happening.positive,
        happening.negative,
        happening.keep_positive,
        happening.keep_negative,
        happening.reads,
    )
    return frozenset(atom.name for group in groups for atom in group)
