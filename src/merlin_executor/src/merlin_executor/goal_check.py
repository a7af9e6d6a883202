# SPDX-License-Identifier: Apache-2.0
"""Checks goals against the domain and the present world, before anything is planned."""

import functools
from typing import Dict, FrozenSet, List, Optional, Sequence

from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, KnowledgeItem

from merlin_pddl.knowledge import arranged
from merlin_pddl.type_hierarchy import OBJECT
from merlin_planning.knowledge_client import KnowledgeClient
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal, to_pddl


class GoalError(ValueError):
    """A goal that cannot be meant; the text says why."""


def check_goals(items: Sequence[KnowledgeItem], knowledge: KnowledgeClient) -> None:
    """Compares goals with the domain and the objects of a knowledge base.

    Arguments that are named by the declared keys are put into the declared order, in the items themselves.

    :raises GoalError: for no goals at all, unknown predicates, functions and objects, wrong types,
        wrong numbers of arguments or keys, and kinds of knowledge that cannot be goals.
    :raises merlin_ros.service_proxy.ServiceError: when the knowledge base does not answer.
    """
    if not items:
        raise GoalError("the request has no goals")
    predicates = knowledge.predicates()
    functions: Optional[Dict[str, DomainFormula]] = None

    @functools.lru_cache(maxsize=None)
    def objects(kind: str = "") -> FrozenSet[str]:
        return frozenset(name.lower() for name in knowledge.instances(kind))

    def check(
        text: str, kind: str, name: str, values: List[KeyValue], known: Dict[str, DomainFormula]
    ) -> None:
        """Checks one predicate or function of a goal. Names do not depend on case."""
        formula, arguments = _formula(name, known), [value.value for value in values]
        if formula is None:
            names = ", ".join(sorted(known)) or "none"
            raise GoalError(f"{text}: the domain has no {kind} {name!r}, only {names}")
        expected = len(formula.typed_parameters)
        if len(arguments) != expected:
            raise GoalError(f"{text}: {name!r} takes {expected} arguments, not {len(arguments)}")
        for argument, parameter in zip(arguments, formula.typed_parameters):
            wanted = parameter.value
            if argument.lower() not in objects():
                raise GoalError(f"{text}: there is no object {argument!r}")
            if wanted.lower() not in ("", OBJECT) and argument.lower() not in objects(wanted):
                types = {name.lower(): kind for name, kind in knowledge.objects().items()}
                raise GoalError(
                    f"{text}: {argument!r} is of type {types.get(argument.lower(), OBJECT)}, but "
                    f"{formula.name!r} takes {wanted} for {parameter.key!r}"
                )

    for item in items:
        if item.knowledge_type == KnowledgeItem.FACT:
            item.values = _in_order(item.attribute_name, item.values, predicates)
            check(to_pddl(item), "predicate", item.attribute_name, item.values, predicates)
        elif item.knowledge_type == KnowledgeItem.INEQUALITY:
            functions = functions if functions is not None else knowledge.function_signatures()
            for token in _functions(item.ineq):
                called = token.function
                called.typed_parameters = _in_order(called.name, called.typed_parameters, functions)
            text = to_pddl(item)
            for token in _functions(item.ineq):
                called = token.function
                check(text, "function", called.name, called.typed_parameters, functions)
            try:
                parse_goal(text)  # a number without end, or an expression that lacks something
            except PDDLSyntaxError as error:
                raise GoalError(f"{text} is not a comparison of two expressions: {error}") from error
        else:
            raise GoalError(f"{to_pddl(item)!r} is neither a fact nor a comparison, so it cannot be a goal")


def _in_order(name: str, pairs: List[KeyValue], known: Dict[str, DomainFormula]) -> List[KeyValue]:
    formula = _formula(name, known)
    labels = [] if formula is None else [parameter.key for parameter in formula.typed_parameters]
    try:
        values = arranged(name, labels, [(pair.key, pair.value) for pair in pairs])
    except ValueError as error:
        raise GoalError(str(error)) from error
    return [KeyValue(key="", value=value) for value in values]


def _formula(name: str, known: Dict[str, DomainFormula]) -> Optional[DomainFormula]:
    return {key.lower(): formula for key, formula in known.items()}.get(name.lower())


def _functions(inequality: DomainInequality) -> List[ExprBase]:
    tokens = [*inequality.LHS.tokens, *inequality.RHS.tokens]
    return [token for token in tokens if token.expr_type == ExprBase.FUNCTION]
