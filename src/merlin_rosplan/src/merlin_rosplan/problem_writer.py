"""Writes a problem as PDDL, without losing anything that the knowledge base holds."""

from typing import Dict, List, Tuple

from merlin_rosplan.domain import Domain
from merlin_rosplan.formula import numeric_text, to_pddl, types_text
from merlin_rosplan.knowledge import Fact, FunctionValue, Instance, Row
from merlin_rosplan.problem import Problem

#: A timed item that is due now still has to come after the start.
EARLIEST = 0.001


class ProblemWriteError(Exception):
    """The problem cannot be said in PDDL; the text says why."""


def write_problem(problem: Problem, domain: Domain) -> str:
    """A problem as PDDL text.

    Raises
    ------
    ProblemWriteError: a timed item is an instance, which PDDL cannot add later.
    """
    lines = [f"(define (problem {problem.name})", f"(:domain {problem.domain_name})", "(:objects"]
    lines.extend(f"    {line}" for line in object_lines(problem, domain))
    lines.append(")")
    lines.append("(:init")
    lines.extend(f"    {fact.text()}" for fact in _in_domain_order(problem.facts, list(domain.predicates)))
    values = _in_domain_order(problem.values, list(domain.functions))
    lines.extend(f"    {_value_text(value)}" for value in values)
    for row in sorted(problem.timed, key=lambda timed: timed.at):
        if isinstance(row.item, Instance):
            raise ProblemWriteError(f"the instance {row.item.text()} is to appear later: PDDL cannot say so")
        item = row.item.text() if isinstance(row.item, Fact) else _value_text(row.item)
        lines.append(f"    (at {numeric_text(max(EARLIEST, round(row.at / 1e9, 6)))} {item})")
    lines.append(")")
    goals = [to_pddl(condition) for condition in problem.goals]
    lines.append("(:goal (and")
    lines.extend(f"    {goal}" for goal in goals)
    lines.append("))")
    if problem.metric is not None:
        lines.append(f"(:metric {problem.metric.optimization} {to_pddl(problem.metric.value)})")
    lines.append(")")
    return "\n".join(lines) + "\n"


def object_lines(problem: Problem, domain: Domain) -> List[str]:
    """The declarations of the objects: one line for each combination of types, in the domain's order.

    An object of several types gets the most specific ones; constants are the domain's business.
    """
    groups: Dict[Tuple[str, ...], List[str]] = {}
    for name, types in problem.objects.items():
        specific = tuple(domain.types.most_specific(kind.lower() for kind in types))
        groups.setdefault(specific, []).append(name)
    order = {name: number for number, name in enumerate(domain.types)}
    typed = sorted(groups.items(), key=lambda group: [order.get(kind, len(order)) for kind in group[0]])
    return [f"{' '.join(names)} - {types_text(types)}" for types, names in typed]


def _value_text(value: FunctionValue) -> str:
    return f"(= {value.text()} {numeric_text(value.value)})"


def _in_domain_order(rows: List[Row], names: List[str]) -> List[Row]:
    """Rows in the order in which the domain declares their names; those it does not declare come last."""
    order = {name: number for number, name in enumerate(names)}
    return sorted(rows, key=lambda row: order.get(row.name.lower(), len(order)))
