"""The domain as ROSPlan's messages tell it."""

from typing import Dict, List, Tuple

from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainAssignment, DomainFormula, DomainOperator

from merlin_pddl.domain import Domain, Operator, Signature
from merlin_pddl.formula import (
    END,
    OVER_ALL,
    START,
    And,
    Atom,
    Comparison,
    Condition,
    Equal,
    Not,
    Or,
    TimedCondition,
)
from merlin_rosplan.messages.expression_messages import FormulaWriter

_ASSIGNMENTS = {
    "assign": DomainAssignment.ASSIGN,
    "increase": DomainAssignment.INCREASE,
    "decrease": DomainAssignment.DECREASE,
    "scale-up": DomainAssignment.SCALE_UP,
    "scale-down": DomainAssignment.SCALE_DOWN,
}
_OPPOSITE = {">": "<=", ">=": "<", "<": ">=", "<=": ">"}
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
        for condition in literals(timed.condition):
            _add_condition(message, writer, TimedCondition(timed.when, condition))
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
                assign_type=_ASSIGNMENTS[effect.op],
                LHS=writer.formula(effect.fluent),
                RHS=writer.expression(effect.value),
            )
            getattr(message, f"{prefix}_assign_effects").append(assignment)
    return message


def _add_condition(message: DomainOperator, writer: FormulaWriter, timed: TimedCondition) -> None:
    prefix = _PREFIX[timed.when]
    condition = timed.condition
    negative = isinstance(condition, Not)
    part = condition.part if isinstance(condition, Not) else condition
    if isinstance(part, Equal):
        part = Atom("=", (part.left, part.right))
    if isinstance(part, Atom):
        kind = "neg" if negative else "simple"
        getattr(message, f"{prefix}_{kind}_condition").append(writer.formula(part))
    elif isinstance(part, Comparison):
        if negative:
            part = Comparison(_OPPOSITE[part.op], part.left, part.right)
        getattr(message, f"{prefix}_comparison").append(writer.comparison(part))


def literals(condition: Condition) -> List[Condition]:
    """The conjuncts of a condition that a list of literals can carry; the others are left out."""
    if isinstance(condition, And):
        return [found for part in condition.parts for found in literals(part)]
    if isinstance(condition, Not):
        part = condition.part
        if isinstance(part, Not):
            return literals(part.part)
        if isinstance(part, Or):
            return [found for inner in part.parts for found in literals(Not(inner))]
        if isinstance(part, Comparison) and part.op == "=":
            return []
        return [condition] if isinstance(part, (Atom, Equal, Comparison)) else []
    if isinstance(condition, Or) and len(condition.parts) == 1:
        return literals(condition.parts[0])
    return [condition] if isinstance(condition, (Atom, Equal, Comparison)) else []
