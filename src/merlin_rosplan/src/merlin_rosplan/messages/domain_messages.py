# SPDX-License-Identifier: Apache-2.0
"""The domain in ROSPlan's messages."""

from typing import Any, Dict, List, Sequence, Tuple

from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainAssignment, DomainFormula, DomainOperator

from merlin_pddl.domain import Domain, Operator, Signature
from merlin_pddl.formula import (
    END,
    OVER_ALL,
    START,
    Atom,
    Comparison,
    Condition,
    Effect,
    Equal,
    Fluent,
    Not,
    TimedCondition,
    Variable,
    must_hold,
)
from merlin_rosplan.messages.expression_messages import (
    ASSIGNMENT_NUMBERS,
    ASSIGNMENTS,
    FormulaWriter,
    read_comparison,
    read_expression,
)

_PREFIX = {START: "at_start", OVER_ALL: "over_all", END: "at_end"}


def signature_message(domain: Domain, signature: Signature) -> DomainFormula:
    """Name and parameters of a predicate, function or operator."""
    return DomainFormula(
        name=signature.name,
        typed_parameters=[KeyValue(p.label, domain.type_name(p.types)) for p in signature.parameters],
    )


def types_message(domain: Domain) -> Tuple[List[str], List[str]]:
    """Types and, for each, its parent (the nearest common one of several; empty when none is written)."""
    names = list(domain.types)
    parents = [domain.types.parents(name) for name in names]
    return names, [domain.type_name(found) if found else "" for found in parents]


def operator_message(domain: Domain, operator: Operator) -> DomainOperator:
    """An operator with the conditions and effects that the message can carry.

    Disjunctions, quantifiers, conditional and continuous effects cannot be carried, as in ROSPlan.
    """
    types: Dict[str, Tuple[str, ...]] = {p.name: p.types for p in operator.parameters}
    writer = FormulaWriter(domain, types)
    message = DomainOperator(formula=signature_message(domain, operator))
    for timed in operator.conditions:
        for condition in must_hold(timed.condition):
            _add_condition(message, writer, timed.when, condition)
    for effect in operator.effects:
        if effect.when == OVER_ALL or effect.variables or effect.conditions:
            continue
        prefix = _PREFIX[effect.when]
        if effect.atom is not None:
            kind = "del" if effect.negative else "add"
            getattr(message, f"{prefix}_{kind}_effects").append(writer.formula(effect.atom))
        else:
            assert effect.fluent is not None and effect.value is not None
            assignment = DomainAssignment(
                assign_type=ASSIGNMENT_NUMBERS[effect.op],
                LHS=writer.formula(effect.fluent),
                RHS=writer.expression(effect.value),
            )
            getattr(message, f"{prefix}_assign_effects").append(assignment)
    return message


def _add_condition(message: DomainOperator, writer: FormulaWriter, when: str, condition: Condition) -> None:
    kind = "neg" if isinstance(condition, Not) else "simple"
    part = condition.part if isinstance(condition, Not) else condition
    if isinstance(part, Equal):
        part = Atom("=", (part.left, part.right))
    if isinstance(part, Atom):
        getattr(message, f"{_PREFIX[when]}_{kind}_condition").append(writer.formula(part))
    elif isinstance(condition, Comparison):
        getattr(message, f"{_PREFIX[when]}_comparison").append(writer.comparison(condition))


def read_operator(message: DomainOperator) -> Operator:
    """The operator in a message of any ROSPlan knowledge base.

    The message does not say whether it is durative: one with nothing over all and at its end counts as
    plain, as it does for the action interfaces.

    :raises UpdateRefused: a numeric expression in it is malformed.
    """
    parameters = {
        pair.key: Variable(f"?{pair.key}", (pair.value,)) for pair in message.formula.typed_parameters
    }

    def arguments(_: str, operands: Sequence[KeyValue]) -> Tuple[str, ...]:
        known = [parameters.get(operand.key) for operand in operands]
        return tuple(each.name if each else operand.key for each, operand in zip(known, operands))

    def atom(formula: DomainFormula) -> Atom:
        return Atom(formula.name, arguments(formula.name, formula.typed_parameters))

    def listed(when: str, suffix: str) -> List[Any]:
        return getattr(message, f"{_PREFIX[when]}_{suffix}", [])

    conditions: List[TimedCondition] = []
    effects: List[Effect] = []
    for when in (START, OVER_ALL, END):
        conditions += [TimedCondition(when, atom(each)) for each in listed(when, "simple_condition")]
        conditions += [TimedCondition(when, Not(atom(each))) for each in listed(when, "neg_condition")]
        conditions += [
            TimedCondition(when, read_comparison(each, arguments)) for each in listed(when, "comparison")
        ]
        effects += [Effect(when, atom(each)) for each in listed(when, "add_effects")]
        effects += [Effect(when, atom(each), negative=True) for each in listed(when, "del_effects")]
        for each in listed(when, "assign_effects"):
            left = atom(each.LHS)
            op = ASSIGNMENTS.get(each.assign_type, "assign")
            value = read_expression(each.RHS, arguments)
            effects.append(Effect(when, fluent=Fluent(left.name, left.args), op=op, value=value))
    durative = any(each.when != START for each in conditions) or any(each.when != START for each in effects)
    return Operator(
        message.formula.name,
        tuple(parameters.values()),
        durative=durative,
        conditions=tuple(conditions),
        effects=tuple(effects),
    )
