# SPDX-License-Identifier: Apache-2.0
"""Whether a goal can be sent: what a client refuses before the hub has it."""

import functools
import re
from typing import Dict, List, Mapping, Tuple

from merlin_executor.core.request_limits import check_size
from merlin_fleet.core import records
from merlin_fleet.core.auction import unsuited
from merlin_fleet.core.records import LONGEST_RECORD, Goal, Profile, Schema
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import Atom, Comparison, Not
from merlin_pddl.knowledge import conjuncts
from merlin_pddl.problem_reader import parse_condition
from merlin_pddl.text_reader import PddlError, read_expression

MOST_NAMED = 20  # in one sentence
UNKNOWN = re.compile(r"unknown (predicate|function|object) ")
DOMAIN = re.compile(r"[^\s@]+(@[0-9a-f]+)?\Z")


def check_goal(goal: Goal) -> None:
    """Checks its texts, and that other clients and robots can read it.

    :raises ValueError: when it cannot be sent.
    """
    if not goal.goals:
        raise ValueError("no goal is given")
    for text in goal.goals:
        if not isinstance(text, str):
            raise ValueError(f"a goal is a text, not {text!r}")
    try:
        check_size(goal.goals)
        for text in goal.goals:
            if not read_expression(text, "goal"):
                raise ValueError(f"'{text}' is an empty goal")
    except PddlError as error:
        raise ValueError(str(error)) from None
    record = records.encode(goal)
    if len(record) > LONGEST_RECORD:
        raise ValueError(
            f"the goal has {len(record)} characters as the hub keeps it; it may have {LONGEST_RECORD}"
        )
    records.decode(Goal, record)
    if goal.robot:
        records.checked_name(goal.robot, "the robot")
    for group in goal.groups:
        _check_listed(group, "the group")
    for capability in goal.needs:
        _check_listed(capability, "the capability")
    if goal.domain and not DOMAIN.match(goal.domain):
        raise ValueError(f"the domain '{goal.domain}' is not a name, or a name, '@' and a hash")


def _check_listed(name: str, what: str) -> None:
    """Checks a name as robots have it, which get theirs in a list with commas."""
    if not name or "," in name or name != name.strip():
        raise ValueError(f"{what} '{name}' is not a name: no robot can have it")


def refused(goal: Goal, robots: Mapping[str, Profile], schemas: Mapping[str, Schema]) -> str:
    """Why no robot of a fleet knows what a goal is about; empty: one does.

    :param robots: all that were ever joined; one that has no schema may know it.
    """
    if goal.robot and goal.robot not in robots:
        return f"there is no robot '{goal.robot}' in the fleet; there is {_listed(robots)}"
    refusing: Dict[str, List[str]] = {}
    for name in sorted(robots):
        if unsuited(goal, robots[name]):
            continue
        reason = refusal(goal.goals, schemas[name]) if name in schemas else ""
        if not reason:
            return ""
        refusing.setdefault(reason, []).append(name)
    return "; ".join(f"{', '.join(names)}: {reason}" for reason, names in refusing.items())


def unsuited_all(goal: Goal, robots: Mapping[str, Profile]) -> str:
    """A sentence for the sender of a goal that no robot can take at present; empty: one can."""
    if all(unsuited(goal, robot) for robot in robots.values()):
        return f"no robot can take it, and it waits for one; the robots of this fleet: {_listed(robots)}"
    return ""


def refusal(goals: Tuple[str, ...], schema: Schema) -> str:
    """Why a robot does not take goals: what is wrong, and what there is; empty: it may take them."""
    try:
        domain, objects = _known(schema)
    except PddlError:
        return ""
    for text in goals:
        try:
            for part in conjuncts(parse_condition(text, domain, objects)):
                literal = part.part if isinstance(part, Not) else part
                if not isinstance(literal, (Atom, Comparison)):
                    return f"{text} is not a fact, a negated fact, a comparison, or (and …) of them"
        except PddlError as error:
            return f"{text}: {error.message}{_instead(error.message, domain, objects)}"
    return ""


def _instead(message: str, domain: Domain, objects: Mapping[str, object]) -> str:
    """What there is in place of an unknown name; the reader of PDDL names what is alike, if anything is."""
    unknown = UNKNOWN.match(message)
    if unknown is None or "did you mean" in message:
        return ""
    known = {"predicate": domain.predicates, "function": domain.functions}
    return f"; there is {_listed(known.get(unknown.group(1), {**domain.constants, **objects}))}"


@functools.lru_cache(maxsize=256)
def _known(schema: Schema) -> Tuple[Domain, Dict[str, Tuple[str, ...]]]:
    """Domain and objects with their types; robots with the same schema share them."""
    objects: Dict[str, Tuple[str, ...]] = {}
    for text in schema.objects:
        name, *types = text.split() or [""]
        objects[name] = (*objects.get(name, ()), *types)
    return parse_domain(schema.domain), objects


def _listed(names: Mapping[str, object]) -> str:
    shown = sorted(names)[:MOST_NAMED]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(shown) + more if shown else "none"
