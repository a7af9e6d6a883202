# SPDX-License-Identifier: Apache-2.0
"""Numeric expressions and comparisons between PDDL values and ROSPlan's messages (prefix notation)."""

from typing import Callable, Dict, List, Mapping, Sequence, Tuple, Union

from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, ExprComposite

from merlin_pddl.domain import Domain, Signature
from merlin_pddl.formula import Arithmetic, Atom, Comparison, Fluent, Number, Numeric, Special
from merlin_pddl.knowledge import ASSIGN, DECREASE, INCREASE, SCALE_DOWN, SCALE_UP, arranged
from merlin_planning.knowledge_text import COMPARISONS, OPERATORS
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused

#: What the numbers of a DomainAssignment and of an item's `assign_op` mean; ASSIGN_CTS has no effect.
ASSIGNMENTS = dict(enumerate((ASSIGN, INCREASE, DECREASE, SCALE_UP, SCALE_DOWN)))
ASSIGNMENT_NUMBERS = {name: number for number, name in ASSIGNMENTS.items()}
_COMPARISON_NAMES = {number: name for name, number in COMPARISONS.items()}
_OPERATION_NAMES = {number: name for name, number in OPERATORS.items()}
_SPECIALS = {"#t": ExprBase.HASHT, "total-time": ExprBase.TOTAL_TIME, "?duration": ExprBase.DURATION}
_SPECIAL_NAMES = {number: name for name, number in _SPECIALS.items()}
_NAMED_SPECIALS = ("is-violated",)  # no number of its own: carried as a function
_MAX_TOKENS = 10_000
_DEEPEST = 90  # levels of a numeric expression: a problem around it is read too


class FormulaWriter:
    """Writes applied predicates and functions as DomainFormula.

    :param domain: knows the declared labels.
    :param variables: types of the operator variables that may be named; None for ground formulas, whose keys
        are the declared labels and whose values are the objects.
    """

    def __init__(self, domain: Domain, variables: Union[Dict[str, Tuple[str, ...]], None] = None) -> None:
        self._domain = domain
        self._variables = variables

    def formula(self, item: Union[Atom, Fluent]) -> DomainFormula:
        """The message of one applied predicate or function."""
        if self._variables is not None:
            pairs = [self._operand(arg) for arg in item.args]
        else:
            known = self._domain.functions if isinstance(item, Fluent) else self._domain.predicates
            signature = known.get(item.name.lower())
            if signature is not None and len(signature.parameters) == len(item.args):
                labels = [parameter.label for parameter in signature.parameters]
            else:
                labels = [str(number) for number in range(len(item.args))]
            pairs = [KeyValue(label, arg) for label, arg in zip(labels, item.args)]
        return DomainFormula(name=item.name, typed_parameters=pairs)

    def _operand(self, term: str) -> KeyValue:
        assert self._variables is not None
        types = self._variables.get(term) or self._domain.constants.get(term, ("object",))
        return KeyValue(term.lstrip("?"), self._domain.type_name(types))

    def expression(self, value: Numeric) -> ExprComposite:
        """The message of a numeric expression."""
        return ExprComposite(tokens=self._tokens(value))

    def _tokens(self, value: Numeric) -> List[ExprBase]:
        if isinstance(value, Number):
            return [ExprBase(expr_type=ExprBase.CONSTANT, constant=value.value)]
        if isinstance(value, Fluent):
            return [ExprBase(expr_type=ExprBase.FUNCTION, function=self.formula(value))]
        if isinstance(value, Special):
            if value.name in _SPECIALS:
                return [ExprBase(expr_type=ExprBase.SPECIAL, special_type=_SPECIALS[value.name])]
            return [
                ExprBase(expr_type=ExprBase.FUNCTION, function=self.formula(Fluent(value.name, value.args)))
            ]
        assert isinstance(value, Arithmetic)
        if len(value.parts) == 1:
            return [ExprBase(expr_type=ExprBase.OPERATOR, op=ExprBase.UMINUS), *self._tokens(value.parts[0])]
        # operators of the messages take two operands: (+ a b c) becomes (+ (+ a b) c)
        tokens = self._tokens(value.parts[0])
        for part in value.parts[1:]:
            operator = ExprBase(expr_type=ExprBase.OPERATOR, op=OPERATORS[value.op])
            tokens = [operator, *tokens, *self._tokens(part)]
        return tokens

    def comparison(self, comparison: Comparison) -> DomainInequality:
        """The message of a comparison."""
        return DomainInequality(
            comparison_type=COMPARISONS[comparison.op],
            LHS=self.expression(comparison.left),
            RHS=self.expression(comparison.right),
        )


#: The terms of a predicate or function of that name, from the pairs of a message.
Arguments = Callable[[str, Sequence[KeyValue]], Tuple[str, ...]]


def by_name(known: Mapping[str, Signature]) -> Arguments:
    """Reads the values by the declared keys, or by position where none of the keys is declared.

    :param known: the predicates or functions.
    :return: raises UpdateRefused for keys of which only some are declared.
    """

    def arguments(name: str, pairs: Sequence[KeyValue]) -> Tuple[str, ...]:
        signature = known.get(name.lower())
        labels = [] if signature is None else [parameter.label for parameter in signature.parameters]
        try:
            return arranged(name, labels, [(pair.key, pair.value) for pair in pairs])
        except ValueError as error:
            raise UpdateRefused(str(error)) from error

    return arguments


#: The values as they stand, whatever their keys: what an original ROSPlan means.
by_position = by_name({})


def read_expression(message: ExprComposite, arguments: Arguments = by_position) -> Numeric:
    """The expression in a message.

    :param arguments: the variables or objects that the arguments of a function stand for.
    :raises UpdateRefused: the tokens are not prefix notation.
    """
    tokens = message.tokens
    if not tokens:
        raise UpdateRefused("a numeric expression is empty")
    if len(tokens) > _MAX_TOKENS:
        raise UpdateRefused(f"a numeric expression has {len(tokens)} tokens")
    # from the right every operator finds its operands on the stack: no recursion, whatever a client sends
    stack: List[Numeric] = []
    for token in reversed(tokens):
        if token.expr_type != ExprBase.OPERATOR:
            stack.append(_operand(token, arguments))
            continue
        wanted = 1 if token.op == ExprBase.UMINUS else 2
        if len(stack) < wanted:
            raise UpdateRefused("an operator of a numeric expression lacks an operand")
        parts = tuple(stack.pop() for _ in range(wanted))
        if token.op != ExprBase.UMINUS and token.op not in _OPERATION_NAMES:
            raise UpdateRefused(f"{token.op} is not an operator of numeric expressions")
        stack.append(Arithmetic(_OPERATION_NAMES.get(token.op, "-"), parts))
        if _depth_exceeded(len(tokens), stack[-1]):
            raise UpdateRefused("a numeric expression is nested too deeply")
    if len(stack) != 1:
        raise UpdateRefused("a numeric expression has operands without an operator")
    return stack[0]


def _depth_exceeded(size: int, value: Numeric) -> bool:
    """Whether an expression is nested more than `_DEEPEST` levels deep; short ones cannot be."""
    if size <= _DEEPEST:
        return False
    depth, level = 0, [value]
    while level:
        depth += 1
        if depth > _DEEPEST:
            return True
        level = [part for node in level if isinstance(node, Arithmetic) for part in node.parts]
    return False


def _operand(token: ExprBase, arguments: Arguments) -> Numeric:
    if token.expr_type == ExprBase.CONSTANT:
        return Number(token.constant)
    if token.expr_type == ExprBase.FUNCTION:
        name = token.function.name
        args = arguments(name, token.function.typed_parameters)
        return Special(name, args) if name.lower() in _NAMED_SPECIALS else Fluent(name, args)
    if token.expr_type == ExprBase.SPECIAL and token.special_type in _SPECIAL_NAMES:
        return Special(_SPECIAL_NAMES[token.special_type])
    raise UpdateRefused(f"a token of a numeric expression has the unknown type {token.expr_type}")


def read_comparison(message: DomainInequality, arguments: Arguments = by_position) -> Comparison:
    """The comparison in a message; `arguments` as for :func:`read_expression`.

    :raises UpdateRefused: it is malformed.
    """
    if message.comparison_type not in _COMPARISON_NAMES:
        raise UpdateRefused(f"{message.comparison_type} is not a comparison")
    name = _COMPARISON_NAMES[message.comparison_type]
    return Comparison(name, read_expression(message.LHS, arguments), read_expression(message.RHS, arguments))
