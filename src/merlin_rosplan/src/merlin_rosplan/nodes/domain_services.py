# SPDX-License-Identifier: Apache-2.0
"""The services of a knowledge base that return the domain."""

from typing import Any, Callable, Dict

import rospy
from rosplan_knowledge_msgs.msg import DomainFormula, DomainOperator
from rosplan_knowledge_msgs.srv import (
    GetDomainAttributeService,
    GetDomainAttributeServiceResponse,
    GetDomainNameService,
    GetDomainNameServiceResponse,
    GetDomainOperatorDetailsService,
    GetDomainOperatorDetailsServiceRequest,
    GetDomainOperatorDetailsServiceResponse,
    GetDomainOperatorService,
    GetDomainOperatorServiceResponse,
    GetDomainPredicateDetailsService,
    GetDomainPredicateDetailsServiceRequest,
    GetDomainPredicateDetailsServiceResponse,
    GetDomainTypeService,
    GetDomainTypeServiceResponse,
)

from merlin_pddl.domain import Domain
from merlin_pddl.text_reader import suggestion
from merlin_rosplan.messages.domain_messages import operator_message, signature_message, types_message
from merlin_rosplan.transport.component import Component


class DomainServices:
    """Offers ``domain/...`` below a component. The answers never change, so they are made once.

    :param component: offers the services.
    :param domain: is returned.
    :param sensed: whether a predicate is kept by the sensing interface.
    """

    def __init__(self, component: Component, domain: Domain, sensed: Callable[[str], bool]) -> None:
        self._sensed = sensed
        self._predicates: Dict[str, DomainFormula] = {
            name: signature_message(domain, found) for name, found in domain.predicates.items()
        }
        self._operators: Dict[str, DomainOperator] = {
            name: operator_message(domain, found) for name, found in domain.operators.items()
        }
        name = GetDomainNameServiceResponse(domain.name)
        types = GetDomainTypeServiceResponse(*types_message(domain))
        predicates = GetDomainAttributeServiceResponse(list(self._predicates.values()))
        functions = GetDomainAttributeServiceResponse(
            [signature_message(domain, found) for found in domain.functions.values()]
        )
        operators = GetDomainOperatorServiceResponse([found.formula for found in self._operators.values()])
        component.service("domain/name", GetDomainNameService, lambda _: name)
        component.service("domain/types", GetDomainTypeService, lambda _: types)
        component.service("domain/predicates", GetDomainAttributeService, lambda _: predicates)
        component.service("domain/functions", GetDomainAttributeService, lambda _: functions)
        component.service("domain/operators", GetDomainOperatorService, lambda _: operators)
        component.service("domain/operator_details", GetDomainOperatorDetailsService, self._operator)
        component.service("domain/predicate_details", GetDomainPredicateDetailsService, self._predicate)

    def _operator(
        self, request: GetDomainOperatorDetailsServiceRequest
    ) -> GetDomainOperatorDetailsServiceResponse:
        return GetDomainOperatorDetailsServiceResponse(_found("operator", self._operators, request.name))

    def _predicate(
        self, request: GetDomainPredicateDetailsServiceRequest
    ) -> GetDomainPredicateDetailsServiceResponse:
        found = _found("predicate", self._predicates, request.name)
        return GetDomainPredicateDetailsServiceResponse(found, self._sensed(request.name))


def _found(kind: str, table: Dict[str, Any], name: str) -> Any:
    """The row of a name.

    :raises rospy.ServiceException: there is none.
    """
    if name.lower() not in table:
        hint = suggestion(name.lower(), table)
        raise rospy.ServiceException(f"the domain has no {kind} '{name[:80]}'{hint}")
    return table[name.lower()]
