# SPDX-License-Identifier: Apache-2.0
"""The services of a knowledge base that journal executions: ``apply_effects`` and ``executions``."""

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
from rosplan_knowledge_msgs.msg import StatusUpdate

from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.transport.component import Component, caller


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
        client = caller(request)
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
