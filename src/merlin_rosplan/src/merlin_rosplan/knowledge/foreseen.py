# SPDX-License-Identifier: Apache-2.0
"""The state that is expected when actions that run now have ended, and one in which other facts hold."""

import itertools
from typing import Sequence

from merlin_pddl.domain import Domain
from merlin_pddl.formula import END, OVER_ALL, START, Atom, Not, to_pddl
from merlin_pddl.knowledge import conjuncts
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import parse_condition
from merlin_rosplan.knowledge.effect_applier import EffectApplier, find_operator
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore


def after_actions(
    domain: Domain, problem: Problem, actions: Sequence[str], then: Sequence[str] = ()
) -> Problem:
    """The problem with all that running actions still bring about; their start counts as done.

    What another one might change until then, and conditions at their ends, do not count.

    :param domain: with its operators.
    :param actions: ground actions as PDDL text, in the order in which they end.
    :param then: those that follow and have not begun, in their order.
    :raises UpdateRefused: one is not of this domain, or its effects cannot be known.
    """
    store = KnowledgeStore(domain, strict=False)
    store.load_problem(problem)
    for number, text in enumerate([*actions, *then]):
        name, *objects = text.strip("() ").split() or [""]
        with store.transaction() as transaction:
            operator = find_operator(transaction.state, name)
            if len(objects) != len(operator.parameters):
                raise UpdateRefused(f"{text} has not the parameters of {operator.name}")
            labels = [parameter.label for parameter in operator.parameters]
            applier = EffectApplier(transaction, operator, dict(zip(labels, objects)))
            seconds = applier.duration() if operator.durative else None
            specials = {} if seconds is None else {"?duration": seconds, "#t": seconds}
            phases = (OVER_ALL, END) if number < len(actions) else (START, OVER_ALL, END)
            allowed = applier.allowed_at_start(specials) if START in phases else {}
            for when in phases if operator.durative else (START,):
                applier.apply(when, specials, allowed)
    found = store.snapshot(problem.name)[1]
    found.constraints = problem.constraints
    return found


def with_facts(domain: Domain, problem: Problem, texts: Sequence[str]) -> None:
    """Changes what holds in a problem.

    :param texts: ``(robot_at hall)``, ``(not (open door))``, ``(= (battery) 20)``, and an ``and`` of such.
    :raises PddlError: one is not PDDL, or names what is not known.
    :raises UpdateRefused: one is no fact or value, or a derived fact.
    """
    objects = problem.typed(domain.constants)
    parts = [conjuncts(parse_condition(text, domain, objects, "fact")) for text in texts]
    if not all(parts):
        raise UpdateRefused(
            f"{texts[parts.index([])]} sets neither a fact nor a value; write (robot_at hall)"
        )
    changes = list(itertools.chain.from_iterable(parts))
    for part in changes:
        atom = part.part if isinstance(part, Not) else part
        if isinstance(atom, Atom) and atom.name in domain.derived:
            raise UpdateRefused(f"{to_pddl(atom)} is derived: it follows from other facts; name those")
    try:
        found = problem.changed(changes)
    except ValueError as error:
        raise UpdateRefused(str(error)) from error
    problem.facts, problem.values = found.facts, found.values
