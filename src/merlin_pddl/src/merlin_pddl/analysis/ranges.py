# SPDX-License-Identifier: Apache-2.0
"""What a number can become: a range with both ends, and the arithmetic of ranges."""

import math
from typing import Callable, Dict, NamedTuple, Sequence

from merlin_pddl.evaluation import compare
from merlin_pddl.formula import OPPOSITE


class Range(NamedTuple):
    """All numbers between two, which may be infinite."""

    low: float
    high: float

    def joined(self, other: "Range") -> "Range":
        """The smallest range that holds both."""
        return Range(min(self.low, other.low), max(self.high, other.high))


ANYTHING = Range(-math.inf, math.inf)
POSITIVE = Range(0.0, math.inf)


def can_compare(op: str, left: Range, right: Range, negated: bool) -> bool:
    """Whether a comparison can hold, or with `negated` can fail, for some numbers of two ranges."""
    if op == "=":
        if negated:
            return not (left.low == left.high == right.low == right.high)
        return compare("<=", left.low, right.high) and compare(">=", left.high, right.low)
    op = OPPOSITE[op] if negated else op
    return compare(op, left.high, right.low) if op in (">", ">=") else compare(op, left.low, right.high)


def arithmetic(op: str, parts: Sequence[Range]) -> Range:
    """The range of ``+ - * /`` over ranges."""
    if len(parts) == 1:
        return Range(-parts[0].high, -parts[0].low) if op == "-" else parts[0]
    result = parts[0]
    for part in parts[1:]:
        result = _OPERATIONS[op](result, part)
    return result


def _times(left: Range, right: Range) -> Range:
    products = [0.0 if 0.0 in (a, b) else a * b for a in left for b in right]
    return Range(min(products), max(products))


def _over(left: Range, right: Range) -> Range:
    if right.low <= 0.0 <= right.high:
        return ANYTHING
    return _times(left, Range(1.0 / right.high, 1.0 / right.low))


_OPERATIONS: Dict[str, Callable[[Range, Range], Range]] = {
    "+": lambda left, right: Range(left.low + right.low, left.high + right.high),
    "-": lambda left, right: Range(left.low - right.high, left.high - right.low),
    "*": _times,
    "/": _over,
}
