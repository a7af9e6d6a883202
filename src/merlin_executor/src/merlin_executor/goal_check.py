# SPDX-License-Identifier: Apache-2.0
"""Checks goals against the domain and the present world, before anything is planned."""

import functools
from typing import Callable, Collection, Dict, FrozenSet, List, Mapping, Optional, Sequence

from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, KnowledgeItem

from merlin_pddl.knowledge import arranged
from merlin_pddl.type_hierarchy import OBJECT
from merlin_planning.knowledge_client import KnowledgeClient
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal, to_pddl


class GoalError(ValueError):
    """A goal that cannot be meant; the text says why."""


def check_atom(
    text: str,
    kind: str,
    name: str,
    arguments: Sequence[str],
    known: Mapping[str, int],
    objects: Collection[str],
) -> None:
    """Checks one predicate or function of a goal. Names do not depend on case.

    :param text: the goal, for messages.
    :param kind: ``predicate`` or ``function``, likewise.
    :param arguments: names of objects.
    :param known: names of that kind in the domain, and how many arguments each takes.
    :param objects: of the world, in lower case.
    :raises GoalError: when it is unknown, takes another number of arguments, or an object is unknown.
    """
    expected = {key.lower(): count for key, count in known.items()}.get(name.lower())
    if expected is None:
        names = ", ".join(sorted(known)) or "none"
        raise GoalError(f"{text}: the domain has no {kind} {name!r}, only {names}")
    if len(arguments) != expected:
        raise GoalError(f"{text}: {name!r} takes {expected} arguments, not {len(arguments)}")
    for argument in arguments:
        if argument.lower() not in objects:
            raise GoalError(f"{text}: there is no object {argument!r}")


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

    for item in items:
        if item.knowledge_type == KnowledgeItem.FACT:
            item.values = _in_order(item.attribute_name, item.values, predicates)
            text = to_pddl(item)
            arguments = [value.value for value in item.values]
            check_atom(text, "predicate", item.attribute_name, arguments, _arities(predicates), objects())
            _check_types(text, _formula(item.attribute_name, predicates), arguments, objects, knowledge)
        elif item.knowledge_type == KnowledgeItem.INEQUALITY:
            functions = functions if functions is not None else knowledge.function_signatures()
            for token in _functions(item.ineq):
                called = token.function
                called.typed_parameters = _in_order(called.name, called.typed_parameters, functions)
            text = to_pddl(item)
            for token in _functions(item.ineq):
                arguments = [value.value for value in token.function.typed_parameters]
                check_atom(text, "function", token.function.name, arguments, _arities(functions), objects())
                _check_types(text, _formula(token.function.name, functions), arguments, objects, knowledge)
            _check_readable(text)
        else:
            raise GoalError(f"{to_pddl(item)!r} is neither a fact nor a comparison, so it cannot be a goal")


def _check_types(
    text: str,
    formula: Optional[DomainFormula],
    arguments: Sequence[str],
    objects: Callable[[str], Collection[str]],
    knowledge: KnowledgeClient,
) -> None:
    """Refuses an object of a type that its parameter does not take.

    :param objects: of a type and of those below it, in lower case.
    """
    assert formula is not None, "the caller has checked its name"
    for argument, parameter in zip(arguments, formula.typed_parameters):
        wanted = parameter.value
        if wanted.lower() not in ("", OBJECT) and argument.lower() not in objects(wanted):
            types = {name.lower(): kind for name, kind in knowledge.objects().items()}
            raise GoalError(
                f"{text}: {argument!r} is of type {types.get(argument.lower(), OBJECT)}, but "
                f"{formula.name!r} takes {wanted} for {parameter.key!r}"
            )


def _check_readable(text: str) -> None:
    """Refuses a comparison with a number without end, or whose expressions lack something."""
    try:
        parse_goal(text)
    except PDDLSyntaxError as error:
        raise GoalError(f"{text} is not a comparison of two expressions: {error}") from error


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


def _arities(formulas: Dict[str, DomainFormula]) -> Dict[str, int]:
    return {name: len(formula.typed_parameters) for name, formula in formulas.items()}


def _functions(inequality: DomainInequality) -> List[ExprBase]:
    tokens = [*inequality.LHS.tokens, *inequality.RHS.tokens]
    return [token for token in tokens if token.expr_type == ExprBase.FUNCTION]
