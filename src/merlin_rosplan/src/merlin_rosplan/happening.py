"""What the start or the end of an action needs and changes: a happening of PDDL 2.1."""

from typing import FrozenSet, Iterable, List, NamedTuple, Sequence

from merlin_rosplan.operator_model import Atom, Conditions, Operator
from merlin_rosplan.plan_graph import NodeType


class Happening(NamedTuple):
    """What one node needs and changes."""

    positive: Sequence[Atom]
    negative: Sequence[Atom]
    add: Sequence[Atom]
    delete: Sequence[Atom]
    # protected until this node, besides what it needs itself: the over-all conditions at an action's end
    keep_positive: Sequence[Atom] = ()
    keep_negative: Sequence[Atom] = ()
    reads: Sequence[Atom] = ()  # function values
    writes: Sequence[Atom] = ()
    depends: FrozenSet[str] = frozenset()  # names in its expressions
    changes: FrozenSet[str] = frozenset()


def _keys(*groups: Iterable[Atom]) -> List[Atom]:
    return list(dict.fromkeys(atom.key for group in groups for atom in group))


def happening_of(action: Operator, type_: NodeType) -> Happening:
    """The happening at the start or the end of a ground action."""
    if type_ == NodeType.ACTION_START:
        return Happening(
            _keys(action.at_start.positive, action.over_all.positive),
            _keys(action.at_start.negative, action.over_all.negative),
            _keys(action.start_effects.add),
            _keys(action.start_effects.delete),
            reads=_keys(
                *(entry.reads for entry in action.at_start.comparisons + action.over_all.comparisons),
                action.start_effects.reads,
            ),
            writes=_keys(action.start_effects.writes),
            depends=expression_names(action.at_start, action.over_all),
            changes=action.start_effects.names,
        )
    return Happening(
        _keys(action.at_end.positive),
        _keys(action.at_end.negative),
        _keys(action.end_effects.add),
        _keys(action.end_effects.delete),
        _keys(action.over_all.positive),
        _keys(action.over_all.negative),
        _keys(
            *(entry.reads for entry in action.at_end.comparisons + action.over_all.comparisons),
            action.end_effects.reads,
        ),
        _keys(action.end_effects.writes),
        expression_names(action.at_end, action.over_all),
        action.end_effects.names,
    )


def expression_names(*conditions: Conditions) -> FrozenSet[str]:
    """Predicates and functions that the expressions of some conditions read."""
    return frozenset().union(*(entry.reads for each in conditions for entry in each.expressions))
