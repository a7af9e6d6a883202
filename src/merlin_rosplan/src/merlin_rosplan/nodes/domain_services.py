# SPDX-License-Identifier: Apache-2.0
"""The services of a knowledge base that return the domain."""

from typing import Callable, Dict

import rospy
from rosplan_knowledge_msgs.msg import DomainFormula, DomainOperator
from rosplan_knowledge_msgs.srv import (
    GetDomainAttributeService,
    GetDomainAttributeServiceRequest,
    GetDomainAttributeServiceResponse,
    GetDomainNameService,
    GetDomainNameServiceRequest,
    GetDomainNameServiceResponse,
    GetDomainOperatorDetailsService,
    GetDomainOperatorDetailsServiceRequest,
    GetDomainOperatorDetailsServiceResponse,
    GetDomainOperatorService,
    GetDomainOperatorServiceRequest,
    GetDomainOperatorServiceResponse,
    GetDomainPredicateDetailsService,
    GetDomainPredicateDetailsServiceRequest,
    GetDomainPredicateDetailsServiceResponse,
    GetDomainTypeService,
    GetDomainTypeServiceRequest,
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
        self._domain = domain
        self._sensed = sensed
        self._predicates: Dict[str, DomainFormula] = {
            name: signature_message(domain, found) for name, found in domain.predicates.items()
        }
        self._functions = [signature_message(domain, found) for found in domain.functions.values()]
        self._operators: Dict[str, DomainOperator] = {
            name: operator_message(domain, found) for name, found in domain.operators.items()
        }
        component.service("domain/name", GetDomainNameService, self._name)
        component.service("domain/types", GetDomainTypeService, self._types)
        component.service("domain/predicates", GetDomainAttributeService, self._all_predicates)
        component.service("domain/functions", GetDomainAttributeService, self._all_functions)
        component.service("domain/operators", GetDomainOperatorService, self._all_operators)
        component.service("domain/operator_details", GetDomainOperatorDetailsService, self._operator)
        component.service("domain/predicate_details", GetDomainPredicateDetailsService, self._predicate)

    def _name(self, _request: GetDomainNameServiceRequest) -> GetDomainNameServiceResponse:
        return GetDomainNameServiceResponse(self._domain.name)

    def _types(self, _request: GetDomainTypeServiceRequest) -> GetDomainTypeServiceResponse:
        return GetDomainTypeServiceResponse(*types_message(self._domain))

    def _all_predicates(
        self, _request: GetDomainAttributeServiceRequest
    ) -> GetDomainAttributeServiceResponse:
        return GetDomainAttributeServiceResponse(list(self._predicates.values()))

    def _all_functions(self, _request: GetDomainAttributeServiceRequest) -> GetDomainAttributeServiceResponse:
        return GetDomainAttributeServiceResponse(self._functions)

    def _all_operators(self, _request: GetDomainOperatorServiceRequest) -> GetDomainOperatorServiceResponse:
        return GetDomainOperatorServiceResponse([found.formula for found in self._operators.values()])

    def _operator(
        self, request: GetDomainOperatorDetailsServiceRequest
    ) -> GetDomainOperatorDetailsServiceResponse:
        found = self._operators.get(request.name.lower())
        if found is None:
            hint = suggestion(request.name.lower(), self._operators)
            raise rospy.ServiceException(f"the domain has no operator '{request.name[:80]}'{hint}")
        return GetDomainOperatorDetailsServiceResponse(found)

    def _predicate(
        self, request: GetDomainPredicateDetailsServiceRequest
    ) -> GetDomainPredicateDetailsServiceResponse:
        found = self._predicates.get(request.name.lower())
        if found is None:
            hint = suggestion(request.name.lower(), self._predicates)
            raise rospy.ServiceException(f"the domain has no predicate '{request.name[:80]}'{hint}")
        return GetDomainPredicateDetailsServiceResponse(found, self._sensed(request.name))
