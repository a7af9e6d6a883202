# SPDX-License-Identifier: Apache-2.0
"""Writes a problem as PDDL, without losing anything that the knowledge base holds."""

from typing import Dict, Iterable, List, Tuple, TypeVar, Union

from merlin_pddl.domain import Domain
from merlin_pddl.evaluation import assigned
from merlin_pddl.formula import numeric_text, to_pddl, types_text
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Key
from merlin_pddl.problem import Problem

Named = TypeVar("Named", Fact, FunctionValue)

#: A timed item that is due now still has to come after the start.
EARLIEST = 0.001


def write_problem(problem: Problem, domain: Domain) -> str:
    """A problem as PDDL text, without instances that appear later: PDDL cannot say so."""
    lines = [f"(define (problem {problem.name})", f"(:domain {problem.domain_name})", "(:objects"]
    lines.extend(f"    {line}" for line in object_lines(problem, domain))
    lines.append(")")
    lines.append("(:init")
    lines.extend(_init_lines(problem, domain))
    lines.append(")")
    goals = [to_pddl(condition) for condition in problem.goals]
    lines.append("(:goal (and")
    lines.extend(f"    {goal}" for goal in goals)
    lines.append("))")
    if problem.constraints:
        lines.append("(:constraints (and")
        lines.extend(f"    {constraint}" for constraint in problem.constraints)
        lines.append("))")
    if problem.metric is not None:
        lines.append(f"(:metric {problem.metric.optimization} {to_pddl(problem.metric.value)})")
    lines.append(")")
    return "\n".join(lines) + "\n"


def _init_lines(problem: Problem, domain: Domain) -> List[str]:
    """What holds, grouped as ROSPlan does it, whose clients compare the text byte for byte.

    A group for each predicate of the domain, one for its timed facts if there are any, and one for each
    function; an empty line ends a group, also an empty one. What ROSPlan cannot say comes last: rows that the
    domain does not declare, and values that change later.
    """
    facts = _by_name(problem.facts, list(domain.predicates))
    values = _by_name(problem.values, list(domain.functions))
    due: Dict[Tuple[str, type, Key], Union[Fact, FunctionValue]] = {}
    for row in assigned(problem.timed, {value.key: value.value for value in problem.values}):
        if not isinstance(row.item, Instance):
            # The last one of a moment counts: of two, even of equal ones, kairos finds no plan.
            at = numeric_text(max(EARLIEST, round(row.at / 1e9, 6)))
            due[at, type(row.item), row.item.key] = row.item
    timed: Dict[str, List[str]] = {}
    for (at, *_), item in due.items():
        name = item.name.lower() if isinstance(item, Fact) else ""
        text = f"    (at {at} {item.text() if isinstance(item, Fact) else _value_text(item)})"
        timed.setdefault(name if name in domain.predicates else "", []).append(text)
    lines: List[str] = []
    for name in domain.predicates:
        lines.extend(f"    {fact.text()}" for fact in facts.pop(name, ()))
        lines.append("")
        if name in timed:
            lines.extend(timed.pop(name))
            lines.append("")
    for name in domain.functions:
        lines.extend(f"    {_value_text(value)}" for value in values.pop(name, ()))
        lines.append("")
    lines.extend(f"    {fact.text()}" for rest in facts.values() for fact in rest)
    lines.extend(f"    {_value_text(value)}" for rest in values.values() for value in rest)
    lines.extend(timed.get("", ()))
    return lines


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


def _by_name(rows: Iterable[Named], names: List[str]) -> Dict[str, List[Named]]:
    """Rows by their name, in lower case where the domain declares it so."""
    known = set(names)
    found: Dict[str, List[Named]] = {}
    for row in rows:
        lower = row.name.lower()
        found.setdefault(lower if lower in known else row.name, []).append(row)
    return found
