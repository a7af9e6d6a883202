# SPDX-License-Identifier: Apache-2.0
"""The state that is expected when actions that run now have ended."""

from typing import Sequence

from merlin_pddl.domain import Domain
from merlin_pddl.formula import END, OVER_ALL, START
from merlin_pddl.problem import Problem
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
            for when in phases if operator.durative else (START,):
                applier.apply(when, specials, {})
    found = store.snapshot(problem.name)[1]
    found.constraints = problem.constraints
    return found
