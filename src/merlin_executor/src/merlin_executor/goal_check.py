"""Tells whether goals make sense in the domain and the present world, before anything is planned."""

from typing import Dict, Iterable, List, Optional, Sequence

from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, KnowledgeItem

from merlin_sm.knowledge_client import KnowledgeClient
from merlin_sm.pddl_text import to_pddl


class GoalError(ValueError):
    """A goal that cannot be meant; the text says why."""


def check_goals(items: Sequence[KnowledgeItem], knowledge: KnowledgeClient) -> None:
    """Compares goals with the domain and the objects of a knowledge base.

    :raises GoalError: for no goals at all, unknown predicates, functions and objects, wrong numbers of
        arguments, and kinds of knowledge that cannot be goals.
    :raises merlin_sm.service_proxy.ServiceError: when the knowledge base does not answer.
    """
    if not items:
        raise GoalError("the request has no goals")
    predicates = knowledge.predicates()
    functions: Optional[Dict[str, DomainFormula]] = None
    objects = {name.lower() for name in knowledge.instances()}
    for item in items:
        text = to_pddl(item)
        if item.knowledge_type == KnowledgeItem.FACT:
            arguments = [value.value for value in item.values]
            _check(text, "predicate", item.attribute_name, arguments, predicates, objects)
        elif item.knowledge_type == KnowledgeItem.INEQUALITY:
            functions = functions if functions is not None else knowledge.function_signatures()
            for token in _functions(item.ineq):
                arguments = [value.value for value in token.function.typed_parameters]
                _check(text, "function", token.function.name, arguments, functions, objects)
        else:
            raise GoalError(f"{text!r} is neither a fact nor a comparison, so it cannot be a goal")


def _check(
    text: str,
    kind: str,
    name: str,
    arguments: List[str],
    known: Dict[str, DomainFormula],
    objects: Iterable[str],
) -> None:
    formula = {key.lower(): value for key, value in known.items()}.get(name.lower())
    if formula is None:
        raise GoalError(
            f"{text}: the domain has no {kind} {name!r}, only {', '.join(sorted(known)) or 'none'}"
        )
    expected = len(formula.typed_parameters)
    if len(arguments) != expected:
        raise GoalError(f"{text}: {name!r} takes {expected} arguments, not {len(arguments)}")
    for argument in arguments:
        if argument.lower() not in objects:
            raise GoalError(f"{text}: there is no object {argument!r}")


def _functions(inequality: DomainInequality) -> List[ExprBase]:
    tokens = [*inequality.LHS.tokens, *inequality.RHS.tokens]
    return [token for token in tokens if token.expr_type == ExprBase.FUNCTION]
