# SPDX-License-Identifier: Apache-2.0
"""What an interrupted execution has used up: numbers that its class declares, and its continuous effects.

Both count the time that has really passed, at most the planned duration.
"""

from typing import Any, Dict, List, Mapping, Sequence, Tuple

from merlin_pddl.domain import Operator
from merlin_pddl.domain_reader import ASSIGNMENTS
from merlin_pddl.evaluation import Evaluator, changed
from merlin_pddl.formula import OVER_ALL, to_pddl
from merlin_pddl.formula_reader import IN_CONTINUOUS, FormulaReader
from merlin_pddl.knowledge import FunctionValue
from merlin_pddl.text_reader import Expression, PddlError, read_expression
from merlin_rosplan.knowledge.effect_applier import EffectApplier
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_state import KnowledgeTables
from merlin_rosplan.knowledge.recorded_changes import RecordedChanges
from merlin_rosplan.knowledge.transaction import Transaction

#: A numeric effect as it stands in the journal: how, function, its arguments, the value as PDDL.
Count = List[Any]


def split(texts: Sequence[str], state: KnowledgeTables) -> Tuple[List[str], List[Count]]:
    """The literals and the numeric effects of a declaration: ``(decrease (battery) (* 0.1 #t))``.

    :raises UpdateRefused: a numeric effect cannot be read, or names something unknown.
    """
    literals: List[str] = []
    counts: List[Count] = []
    for text in texts:
        try:
            node = read_expression(text)
            numeric = node.head in ASSIGNMENTS and node.head not in state.domain.predicates
            if numeric:
                counts.append(_count(node, state))
            else:
                literals.append(text)
        except PddlError as error:
            raise UpdateRefused(f"'{text}': {error}") from error
    return literals, counts


def _count(node: Expression, state: KnowledgeTables) -> Count:
    if len(node) != 3:
        raise node.error(f"'{node.head}' takes a function and a value")
    reader = FormulaReader(state.domain, state.all_objects())
    fluent, value = reader.fluent(node[1], {}), reader.numeric(node[2], IN_CONTINUOUS)
    return [node.head, fluent.name, list(fluent.args), to_pddl(value)]


def passed(elapsed: float, planned: Any) -> Dict[str, float]:
    """``#t`` and ``?duration`` of an execution that was interrupted, s.

    :param elapsed: how long it ran, s.
    :param planned: duration, s; None: not known.
    """
    if planned is None:
        return {"#t": elapsed, "?duration": elapsed}
    return {"#t": min(elapsed, planned), "?duration": planned}


def apply_continuous(
    transaction: Transaction, operator: Operator, parameters: Mapping[str, str], specials: Mapping[str, float]
) -> str:
    """Applies the continuous effects of the time that has passed; returns why not, empty when it did."""
    if all(effect.when != OVER_ALL for effect in operator.effects):
        return ""
    try:
        EffectApplier(transaction, operator, parameters).apply(OVER_ALL, specials, {})
    except UpdateRefused as error:
        return str(error)
    return ""


def apply_counts(
    transaction: Transaction, counts: Sequence[Count], specials: Mapping[str, float]
) -> List[str]:
    """Applies declared numeric effects, each on the result of the one before; returns those that failed."""
    state: KnowledgeTables = transaction.state
    changes = RecordedChanges(transaction)
    failed = []
    for op, name, args, text in counts:
        spelled = [state.spelling(arg) for arg in args]
        result = _result(state, op, (name, *args), text, specials) if None not in spelled else None
        value = None if result is None else FunctionValue(name, tuple(map(str, spelled)), result)
        if value is None or not transaction.acceptable(value):
            failed.append(f"({op} ({' '.join((name, *args))}) {text})")
        else:
            changes.set(value, op)
    return failed


def _result(
    state: KnowledgeTables, op: str, key: Tuple[str, ...], text: str, specials: Mapping[str, float]
) -> Any:
    objects: Dict[str, Tuple[str, ...]] = dict.fromkeys(state.objects(("object",)), ("object",))
    try:
        node = read_expression(f"(+ 0 {text})")  # a single word is not an expression
        value = Evaluator(state.domain, state, specials).number(
            _LooseReader(state.domain, objects).numeric(node, IN_CONTINUOUS)
        )
    except PddlError:  # an object of it is gone
        return None
    return changed(op, state.value(key), value)


class _LooseReader(FormulaReader):
    """Reads what was checked when the execution began; the types of objects no longer matter."""

    def types_of(self, term: str, scope: Mapping[str, Tuple[str, ...]]) -> Tuple[str, ...]:
        """Every type of the domain: any term fits anywhere."""
        return ("object", *self._domain.types)
