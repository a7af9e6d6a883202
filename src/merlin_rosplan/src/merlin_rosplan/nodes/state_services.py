# SPDX-License-Identifier: Apache-2.0
"""The services of a knowledge base that return its state."""

import time
from typing import Any, Callable

import rospy
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetAttributeServiceRequest,
    GetAttributeServiceResponse,
    GetInstanceService,
    GetInstanceServiceRequest,
    GetInstanceServiceResponse,
    GetMetricService,
    GetMetricServiceRequest,
    GetMetricServiceResponse,
)

from merlin_pddl.knowledge import Fact
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader, KnowledgeWriter
from merlin_rosplan.messages.wire_items import (
    AnyItem,
    Query,
    QueryRequest,
    QueryResponse,
    StoredItems,
    bounded,
    refuse_too_many,
)
from merlin_rosplan.transport.component import Component

#: s of wall time that the answer to one ``query_state`` may take
MAX_QUERY_TIME = 60.0


class StateServices:
    """Offers ``state/...`` and ``query_state`` below a component."""

    def __init__(self, component: Component, store: KnowledgeStore, max_items: int, keys: bool) -> None:
        self._name = component.scope
        self._max_query_time = component.number("max_query_time", MAX_QUERY_TIME, 0)
        self._store = store
        self._reader = KnowledgeReader(store.domain, keys)
        self._writer = KnowledgeWriter(store.domain)
        component.service("state/instances", GetInstanceService, self._instances)
        component.service("state/propositions", GetAttributeService, self._propositions)
        component.service("state/functions", GetAttributeService, self._functions)
        component.service("state/timed_knowledge", GetAttributeService, self._timed)
        component.service("state/goals", GetAttributeService, self._goals)
        component.service("state/metric", GetMetricService, self._metric)
        component.service("query_state", bounded(Query, max_items), self._query)

    def _instances(self, request: GetInstanceServiceRequest) -> GetInstanceServiceResponse:
        names = self._store.instances(request.type_name, request.include_constants, request.include_subtypes)
        return GetInstanceServiceResponse(names)

    def _propositions(self, request: GetAttributeServiceRequest) -> StoredItems:
        return StoredItems(self._store.facts(request.predicate_name), self._writer)

    def _functions(self, request: GetAttributeServiceRequest) -> StoredItems:
        return StoredItems(self._store.values(request.predicate_name), self._writer)

    def _timed(self, request: GetAttributeServiceRequest) -> GetAttributeServiceResponse:
        rows = self._store.timed(request.predicate_name)
        return GetAttributeServiceResponse([self._writer.timed(row) for row in rows])

    def _goals(self, _request: GetAttributeServiceRequest) -> GetAttributeServiceResponse:
        return GetAttributeServiceResponse([self._writer.goal(goal) for goal in self._store.goals()])

    def _metric(self, _request: GetMetricServiceRequest) -> GetMetricServiceResponse:
        return GetMetricServiceResponse(self._writer.metric(self._store.metric))

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
