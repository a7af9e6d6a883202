# SPDX-License-Identifier: Apache-2.0
"""Small changes of a module's text, drawn from a seed.

The operators are cosmic-ray's, and one of ours. Its sessions are not used: they change the files in place,
run one fixed command for all modules, and do not sample.
"""

import ast
import random
from collections import defaultdict
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple, Sequence, Tuple

import parso
from cosmic_ray.ast import Visitor, ast_nodes, get_ast
from cosmic_ray.operators.operator import Operator
from cosmic_ray.operators.provider import OperatorProvider

#: Of cosmic-ray's 213 operators those whose result an author could write: `<` for `<=`, not `<<` for `+`.
OPERATORS = (
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "NumberReplacer",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ExceptionReplacer",
    "ZeroIterationForLoop",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceBinaryOperator_Add_Sub",
    "ReplaceBinaryOperator_Sub_Add",
    "ReplaceBinaryOperator_Mul_Div",
    "ReplaceBinaryOperator_Div_Mul",
    "ReplaceBinaryOperator_BitOr_BitAnd",
    "ReplaceBinaryOperator_BitAnd_BitOr",
    "ReplaceComparisonOperator_Eq_NotEq",
    "ReplaceComparisonOperator_NotEq_Eq",
    "ReplaceComparisonOperator_Is_IsNot",
    "ReplaceComparisonOperator_IsNot_Is",
    "ReplaceComparisonOperator_Lt_LtE",
    "ReplaceComparisonOperator_LtE_Lt",
    "ReplaceComparisonOperator_Gt_GtE",
    "ReplaceComparisonOperator_GtE_Gt",
    "ReplaceComparisonOperator_Lt_GtE",
    "ReplaceComparisonOperator_Gt_LtE",
)


class Mutant(NamedTuple):
    """One changed module: the first line that differs, before and after, and the whole text."""

    module: Path
    line: int
    before: str
    after: str
    text: str


class LeaveOut(Operator):
    """Leaves out a call, an assignment to an attribute or an item, or a result; cosmic-ray does not."""

    def mutation_positions(self, node: Any) -> Iterator[Tuple[Any, Any]]:
        """The places: at most one per node."""
        target = node.children[0] if node.type == "expr_stmt" else node
        trailer = target.children[-1] if target.type == "atom_expr" else None
        is_call = trailer is not None and node is target and trailer.children[0] == "("
        stores = trailer is not None and node is not target
        if (is_call and node.parent.type == "simple_stmt") or stores:
            yield node.start_pos, node.end_pos
        elif node.type == "return_stmt" and node.children[1].type != "keyword":
            yield node.children[1].start_pos, node.children[1].end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """The node without its effect."""
        if node.type == "return_stmt":
            node.children[1] = parso.parse(" None")
            return node
        return parso.parse(node.get_first_leaf().prefix + "pass")

    @classmethod
    def examples(cls) -> Sequence[Any]:
        """None: they document cosmic-ray's own operators."""
        return ()


class _Change(Visitor):
    """Changes one place of a tree."""

    def __init__(self, operator: Operator, occurrence: int) -> None:
        self._operator, self._left = operator, occurrence

    def visit(self, node: Any) -> Any:
        """The node, changed when it holds the place that was asked for."""
        for index, _ in enumerate(self._operator.mutation_positions(node)):
            self._left -= 1
            if self._left == -1:
                return self._operator.mutate(node, index)
        return node


def mutants(module: Path, sample: int, seed: int, root: Path) -> List[Mutant]:
    """A drawn sample of a module's mutants, at most one per place; the same for the same text and seed."""
    source = module.read_text(encoding="utf-8")
    nodes = list(ast_nodes(get_ast(source)))
    provider = OperatorProvider()
    places: Dict[Any, List[Tuple[Operator, int]]] = defaultdict(list)
    for operator in [LeaveOut(), *(provider[name]() for name in OPERATORS)]:
        found = [place for node in nodes for place in operator.mutation_positions(node)]
        for occurrence, place in enumerate(found):
            places[place].append((operator, occurrence))
    draw = random.Random(f"{seed} {module.relative_to(root)}")
    made: List[Mutant] = []
    for place in draw.sample(sorted(places), len(places)):
        if len(made) == sample:
            break
        text = _Change(*draw.choice(places[place])).walk(get_ast(source)).get_code()
        if _means_something_else(source, text):
            pairs = enumerate(zip(source.splitlines(), text.splitlines()), 1)
            line, before, after = next((at, old, new) for at, (old, new) in pairs if old != new)
            made.append(Mutant(module, line, before.strip(), after.strip(), text))
    return made


def _means_something_else(source: str, text: str) -> bool:
    try:
        return ast.dump(ast.parse(text)) != ast.dump(ast.parse(source))
    except SyntaxError:  # the star before keyword parameters does not multiply
        return False
