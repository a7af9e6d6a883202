# SPDX-License-Identifier: Apache-2.0
"""A problem that only better plans solve: for a planner whose search does not follow the metric."""

import re
from typing import NamedTuple, Optional

from merlin_pddl.text_reader import Expression, Node, PddlError, read_expression

#: What is not a function of the last state, so that no goal can speak of it.
_OF_THE_PLAN = ("total-time", "is-violated")
_METRIC = re.compile(r"\(\s*:metric\b(\s+minimize\s*\(\s*total-(?:cost|time)\s*\))?", re.IGNORECASE)
#: By how much, and by which part of its value, a metric has to be better to count.
_STEP, _PART = 1e-4, 1e-6


class MetricGoal(NamedTuple):
    """A problem and its metric.

    :param head: of the problem, up to its goal.
    :param goal, metric: as PDDL.
    :param maximize: the sense of the metric.
    """

    head: str
    goal: str
    metric: str
    maximize: bool

    @staticmethod
    def of(problem: str) -> Optional["MetricGoal"]:
        """The metric of a problem; None where kairos follows it itself, or where it is not of the last state.

        :param problem: PDDL text.
        """
        found = _METRIC.search(problem)
        if found is None or found.group(1):  # a large problem takes its time to be read
            return None
        try:
            sections = {part.head: part for part in read_expression(problem) if isinstance(part, Expression)}
        except PddlError:
            return None
        metric, goal = sections.pop(":metric", None), sections.pop(":goal", None)
        if metric is None or goal is None or len(metric) != 3 or len(goal) != 2:
            return None
        text, maximize = _text(metric[2]), metric[1] == "maximize"
        if any(word in text for word in _OF_THE_PLAN):
            return None
        head = "".join(section.text() for section in sections.values())
        return MetricGoal(f"(define {head}", _text(goal[1]), text, maximize)

    def better_than(self, value: float, by: float = 0.0) -> str:
        """The problem of a plan whose metric is better than a value.

        :param by: how much, at least; 0: by as little as counts.
        """
        least = max(by, _STEP, _PART * abs(value))
        sign, bound = (">=", value + least) if self.maximize else ("<=", value - least)
        return f"{self.head} (:goal (and {self.goal} ({sign} {self.metric} {_number(bound)}))))"


def _text(node: Node) -> str:
    return node.text() if isinstance(node, Expression) else str(node)


def _number(value: float) -> str:
    # PDDL has no sign before a number and no exponent.
    text = f"{abs(value):.6f}"
    return f"(- {text})" if value < 0 else text
