# SPDX-License-Identifier: Apache-2.0
"""PDDL text of facts and goals, to knowledge items and back.

Literals, numeric comparisons and conjunctions, as goals and action effects need them. Whole domains and
problems are the planning system's business.
"""

import re
from typing import Any, Dict, Iterator, List, Optional, Sequence

from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, ExprComposite, KnowledgeItem

from merlin_pddl.formula import numeric_text
from merlin_pddl.plan_text import call_text
from merlin_pddl.text_reader import (
    Expression,
    Node,
    PddlError,
    Word,
    head_of,
    is_name,
    read_expression,
    simple_goals,
)

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\Z")
#: Comparison in PDDL → its number in messages.
COMPARISONS = {
    ">": DomainInequality.GREATER,
    ">=": DomainInequality.GREATEREQ,
    "<": DomainInequality.LESS,
    "<=": DomainInequality.LESSEQ,
    "=": DomainInequality.EQUALS,
}
#: Arithmetic operation in PDDL → its number in messages.
OPERATORS = {"+": ExprBase.ADD, "-": ExprBase.SUB, "*": ExprBase.MUL, "/": ExprBase.DIV}
_COMPARISON_TEXT = {value: text for text, value in COMPARISONS.items()}
_OPERATOR_TEXT = {value: text for text, value in OPERATORS.items()}
_SPECIAL_TEXT = {ExprBase.HASHT: "#t", ExprBase.TOTAL_TIME: "total-time", ExprBase.DURATION: "?duration"}

_SHOWN = 80  # characters of a text that a message repeats


class PDDLSyntaxError(ValueError):
    """Text that is not PDDL of facts and goals; the message says what is wrong and where."""


def parse_goal(text: str) -> List[KnowledgeItem]:
    """The goals of a PDDL goal text.

    :param text: a literal, a comparison, or an ``and``: ``(and (checked kitchen) (>= (battery) 20))``.
    :raises PDDLSyntaxError: when it is something else, or nested too deeply.
    """
    try:
        return [_goal(*goal) for goal in simple_goals(read_expression(text))]
    except PddlError as error:
        raise PDDLSyntaxError(f"{_shown(text)}, {_place(error)}{error.message}") from error


def parse_literals(texts: Sequence[str], binding: Optional[Dict[str, str]] = None) -> List[KnowledgeItem]:
    """Facts, positive and negative, with ``?variables`` replaced.

    :param binding: variable without ``?``, in any case → object.
    :raises PDDLSyntaxError: for other PDDL, or for a variable that is not bound.
    """
    items: List[KnowledgeItem] = []
    objects = {name.lower(): value for name, value in (binding or {}).items()}
    for text in texts:
        for item in parse_goal(text):
            if item.knowledge_type != KnowledgeItem.FACT:
                raise PDDLSyntaxError(f"{text!r} is not a literal")
            for value in item.values:
                if value.value.startswith("?"):
                    name = value.value[1:]
                    if name.lower() not in objects:
                        raise PDDLSyntaxError(f"{text!r}: nothing is bound to ?{name}")
                    value.value = objects[name.lower()]
            items.append(item)
    return items


def to_pddl(item: KnowledgeItem) -> str:
    """A knowledge item as PDDL text."""
    if item.knowledge_type == KnowledgeItem.INSTANCE:
        return f"{item.instance_name} - {item.instance_type}"
    if item.knowledge_type == KnowledgeItem.INEQUALITY:
        operator = _COMPARISON_TEXT.get(item.ineq.comparison_type, "?")
        text = f"({operator} {_expression_text(item.ineq.LHS)} {_expression_text(item.ineq.RHS)})"
    elif item.knowledge_type == KnowledgeItem.EXPRESSION:
        if item.expr.tokens or not item.attribute_name:  # a metric
            return f"{item.optimization} {_expression_text(item.expr)}"
        text = item.attribute_name
    else:
        text = call_text(item.attribute_name, [value.value for value in item.values])
        if item.knowledge_type == KnowledgeItem.FUNCTION:
            return f"(= {text} {numeric_text(item.function_value)})"
    return f"(not {text})" if item.is_negative else text


def action_text(name: str, parameters: Sequence[KeyValue]) -> str:
    """A ground action as PDDL text: ``(navigate anywhere kitchen)``."""
    return call_text(name, [parameter.value for parameter in parameters])


def step_text(action: Any) -> str:
    """The same of a message with the name and the parameters of an action."""
    return action_text(action.name, action.parameters)


def _shown(text: str) -> str:
    return repr(text) if len(text) <= _SHOWN else f"{text[:_SHOWN]!r}…"


def _place(error: PddlError) -> str:
    if error.line > 1:
        return f"line {error.line}, column {error.column}: "
    return f"column {error.column}: "


def _goal(expression: Expression, negated: bool) -> KnowledgeItem:
    head, rest = head_of(expression)
    if head not in COMPARISONS:
        return KnowledgeItem(
            knowledge_type=KnowledgeItem.FACT,
            attribute_name=_name(head),
            values=list(_arguments(rest)),
            is_negative=negated,
        )
    if len(rest) != 2:
        raise head.error(f"{head!r} compares two expressions")
    ineq = DomainInequality(
        comparison_type=COMPARISONS[head],
        LHS=ExprComposite(tokens=list(_tokens(rest[0]))),
        RHS=ExprComposite(tokens=list(_tokens(rest[1]))),
    )
    return KnowledgeItem(knowledge_type=KnowledgeItem.INEQUALITY, ineq=ineq)


def _arguments(nodes: Sequence[Node]) -> Iterator[KeyValue]:
    for node in nodes:
        if not isinstance(node, Word):
            raise node.error("an argument has to be a name, not an expression")
        yield KeyValue(key="", value=node.written)


def _name(word: Word) -> str:
    if not is_name(word):
        raise word.error(f"{word.written!r} is not a name")
    return word.written


def _tokens(expression: Node) -> Iterator[ExprBase]:
    if isinstance(expression, Word):
        if not _NUMBER.match(expression):
            raise expression.error(f"{expression.written!r} is neither a number nor a function")
        yield ExprBase(expr_type=ExprBase.CONSTANT, constant=float(expression))
        return
    head, rest = head_of(expression)
    if head in OPERATORS and (len(rest) == 2 or (len(rest) > 2 and head in "+*")):
        for _ in rest[1:]:  # that of a message takes two operands: (+ a b c) is (+ (+ a b) c)
            yield ExprBase(expr_type=ExprBase.OPERATOR, op=OPERATORS[head])
        for part in rest:
            yield from _tokens(part)
    elif head == "-" and len(rest) == 1:
        yield ExprBase(expr_type=ExprBase.OPERATOR, op=ExprBase.UMINUS)
        yield from _tokens(rest[0])
    else:
        formula = DomainFormula(name=_name(head), typed_parameters=list(_arguments(rest)))
        yield ExprBase(expr_type=ExprBase.FUNCTION, function=formula)


def _expression_text(expression: ExprComposite) -> str:
    """An expression in prefix order as PDDL text; ``?`` for what is missing."""
    operands: List[str] = []  # read from the right, the operands of an operator stand there before it

    def operand() -> str:
        return operands.pop() if operands else "?"

    for token in reversed(expression.tokens):
        if token.expr_type == ExprBase.CONSTANT:
            text = numeric_text(token.constant)
        elif token.expr_type == ExprBase.FUNCTION:
            arguments = [value.value for value in token.function.typed_parameters]
            text = call_text(token.function.name, arguments)
        elif token.expr_type == ExprBase.OPERATOR and token.op == ExprBase.UMINUS:
            text = f"(- {operand()})"
        elif token.expr_type == ExprBase.OPERATOR:
            text = f"({_OPERATOR_TEXT.get(token.op, '?')} {operand()} {operand()})"
        else:
            text = _SPECIAL_TEXT.get(token.special_type, "?")
        operands.append(text)
    return operand()
