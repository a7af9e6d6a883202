# SPDX-License-Identifier: Apache-2.0
"""The services of a knowledge base: its domain, its state, and its journal of executions."""

import time
from typing import Any, Callable, Dict, Iterable, Mapping

import genpy
import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import OpenExecution
from merlin_msgs.srv import (
    ApplyEffects,
    ApplyEffectsRequest,
    ApplyEffectsResponse,
    ListExecutions,
    ListExecutionsRequest,
    ListExecutionsResponse,
)
from rosplan_knowledge_msgs import srv
from rosplan_knowledge_msgs.msg import KnowledgeItem, StatusUpdate

from merlin_pddl.domain import Domain
from merlin_pddl.knowledge import Fact
from merlin_pddl.text_reader import suggestion
from merlin_ros.actions.peers import sender_of
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.domain_messages import operator_message, signature_message, types_message
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader, KnowledgeWriter
from merlin_rosplan.messages.wire_items import (
    AnyItem,
    QueryRequest,
    QueryResponse,
    StoredItems,
    bounded,
    refuse_too_many,
)
from merlin_rosplan.transport.component import Component

#: s of wall time that the answer to one ``query_state`` may take
MAX_QUERY_TIME = 60.0


class ExecutionServices:
    """Offers ``apply_effects`` and ``executions`` below a component.

    :param component: whose names these are.
    :param store: keeps the journal with the knowledge.
    :param status: gets an update after every request that counted.
    """

    def __init__(self, component: Component, store: KnowledgeStore, status: rospy.Publisher) -> None:
        self._name = component.scope
        self._store = store
        self._status = status
        component.service("apply_effects", ApplyEffects, self._apply)
        component.service("executions", ListExecutions, self._list)

    def _apply(self, request: ApplyEffectsRequest) -> ApplyEffectsResponse:
        client = sender_of(request)
        try:
            with self._store.transaction(client) as transaction:
                message = self._change(Executions(transaction), request, client)
        except UpdateRefused as error:
            rospy.logwarn("%s/apply_effects refused what %s sent: %s", self._name, client, error)
            return ApplyEffectsResponse(False, str(error))
        self._status.publish(StatusUpdate(client, rospy.get_rostime()))
        return ApplyEffectsResponse(True, message)

    @staticmethod
    def _change(executions: Executions, request: ApplyEffectsRequest, client: str) -> str:
        parameters = {pair.key: pair.value for pair in request.parameters}
        token, operator = request.token, request.operator_name
        if request.phase == ApplyEffectsRequest.START:
            owner = request.owner or client
            return executions.start(
                token, operator, parameters, owner, request.while_running, request.if_interrupted
            )
        if request.phase == ApplyEffectsRequest.END:
            return executions.end(token, operator, parameters)
        if request.phase == ApplyEffectsRequest.ROLLBACK:
            return executions.rollback(token, operator)
        if request.phase == ApplyEffectsRequest.INTERRUPT:
            return executions.interrupt(token, operator)
        raise UpdateRefused(f"there is no phase {request.phase}")

    def _list(self, request: ListExecutionsRequest) -> ListExecutionsResponse:
        return ListExecutionsResponse(
            [
                OpenExecution(
                    token=found.token,
                    operator_name=found.operator,
                    parameters=[KeyValue(key=label, value=value) for label, value in found.parameters],
                    owner=found.owner,
                    began=genpy.Time(0, found.began),
                    meanwhile=list(found.meanwhile),
                )
                for found in self._store.executions(request.owner)
            ]
        )


class DomainServices:
    """Offers ``domain/...`` below a component. The answers never change, so they are made once.

    :param component: offers the services.
    :param domain: is returned.
    :param sensed: whether a predicate is kept by the sensing interface.
    """

    def __init__(self, component: Component, domain: Domain, sensed: Callable[[str], bool]) -> None:
        self._sensed = sensed
        self._predicates = {
            name: signature_message(domain, found) for name, found in domain.predicates.items()
        }
        self._operators = {name: operator_message(domain, found) for name, found in domain.operators.items()}
        formulas = [operator.formula for operator in self._operators.values()]
        functions = [signature_message(domain, found) for found in domain.functions.values()]
        for name, kind, answer in (
            ("name", srv.GetDomainNameService, [domain.name]),
            ("types", srv.GetDomainTypeService, types_message(domain)),
            ("predicates", srv.GetDomainAttributeService, [list(self._predicates.values())]),
            ("functions", srv.GetDomainAttributeService, [functions]),
            ("operators", srv.GetDomainOperatorService, [formulas]),
        ):
            component.service(f"domain/{name}", kind, _always(kind._response_class(*answer)))
        component.service("domain/operator_details", srv.GetDomainOperatorDetailsService, self._operator)
        component.service("domain/predicate_details", srv.GetDomainPredicateDetailsService, self._predicate)

    def _operator(self, request: Any) -> srv.GetDomainOperatorDetailsServiceResponse:
        found = _named("operator", request.name, self._operators)
        return srv.GetDomainOperatorDetailsServiceResponse(found)

    def _predicate(self, request: Any) -> srv.GetDomainPredicateDetailsServiceResponse:
        found = _named("predicate", request.name, self._predicates)
        return srv.GetDomainPredicateDetailsServiceResponse(found, self._sensed(request.name))


def _always(response: Any) -> Callable[[Any], Any]:
    return lambda _request: response


def _named(kind: str, name: str, known: Mapping[str, Any]) -> Any:
    found = known.get(name.lower())
    if found is None:
        hint = suggestion(name.lower(), known)
        raise rospy.ServiceException(f"the domain has no {kind} '{name[:80]}'{hint}")
    return found


class StateServices:
    """Offers ``state/...`` and ``query_state`` below a component."""

    def __init__(self, component: Component, store: KnowledgeStore, max_items: int, keys: bool) -> None:
        self._name = component.scope
        self._max_query_time = component.number("max_query_time", MAX_QUERY_TIME, 0)
        self._store = store
        self._reader = KnowledgeReader(store.domain, keys)
        component.service("state/instances", srv.GetInstanceService, self._instances)
        writer = KnowledgeWriter(store.domain)
        answers: Dict[str, Callable[[str], Any]] = {
            "propositions": lambda name: StoredItems(store.facts(name), writer),
            "functions": lambda name: StoredItems(store.values(name), writer),
            "timed_knowledge": lambda name: _items(map(writer.timed, store.timed(name))),
            "goals": lambda _: _items(map(writer.goal, store.goals())),
        }
        for name, answer in answers.items():
            component.service(f"state/{name}", srv.GetAttributeService, _of_name(answer))
        component.service(
            "state/metric",
            srv.GetMetricService,
            lambda _: srv.GetMetricServiceResponse(writer.metric(store.metric)),
        )
        queries = bounded(srv.KnowledgeQueryService, QueryRequest, max_items)
        component.service("query_state", queries, self._query)

    def _instances(self, request: srv.GetInstanceServiceRequest) -> srv.GetInstanceServiceResponse:
        names = self._store.instances(request.type_name, request.include_constants, request.include_subtypes)
        return srv.GetInstanceServiceResponse(names)

    def _query(self, request: QueryRequest) -> QueryResponse:
        refuse_too_many(request)
        asked = [self._asked(message) for message in request.knowledge]
        results = self._store.query(asked, self._limit())
        false = [message for message, result in zip(request.knowledge, results) if not result]
        return QueryResponse(results, false)

    def _limit(self) -> Callable[[], None]:
        """Ends a query that takes too long, whose client may be gone: three quantifiers can take hours."""
        end = time.monotonic() + self._max_query_time

        def check() -> None:
            if rospy.is_shutdown():
                raise rospy.ServiceException("the knowledge base ends")
            if self._max_query_time and time.monotonic() > end:
                raise rospy.ServiceException(
                    f"not answered within the {self._max_query_time:g} s of ~max_query_time: its quantifiers "
                    "go through too many objects"
                )

        return check

    def _asked(self, message: AnyItem) -> Any:
        try:
            item = self._reader.query(message, self._store.objects)
        except UpdateRefused as error:
            rospy.logwarn("%s/query_state: %s", self._name, error)
            return None
        self._warn_unknown(item)
        return item

    def _warn_unknown(self, item: Any) -> None:
        known = self._store.domain.predicates
        if isinstance(item, Fact) and item.name and item.name != "=" and item.name.lower() not in known:
            rospy.logwarn_throttle_identical(
                60.0, f"{self._name}/query_state: the domain has no predicate '{item.name[:80]}'"
            )


def _items(items: Iterable[KnowledgeItem]) -> srv.GetAttributeServiceResponse:
    return srv.GetAttributeServiceResponse(list(items))


def _of_name(answer: Callable[[str], Any]) -> Callable[[srv.GetAttributeServiceRequest], Any]:
    return lambda request: answer(request.predicate_name)
