"""Settles what an earlier life of this node has begun and left open in the knowledge base."""

from typing import List, NamedTuple

import rospy
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest, ListExecutions

from merlin_actions.core.execution import Token
from merlin_actions.core.execution_queue import Key
from merlin_actions.effects import APPLY_LIMIT
from merlin_ros.actions.lease_holder import LIFE
from merlin_ros.service_proxy import ServiceProxy
from merlin_sm.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_sm.knowledge_text import action_text


class LeftExecution(NamedTuple):
    """An execution that was settled."""

    key: Key
    text: str


def settle_left(knowledge: KnowledgeClient, operator: str) -> List[LeftExecution]:
    """Closes the open executions of an operator that an earlier life of this node has left.

    Nothing of them goes on: their state machines have lost their owner.

    :raises KnowledgeError: when the knowledge base refuses.
    :raises merlin_ros.service_proxy.ServiceError: when it does not answer.
    """
    listed = ServiceProxy(f"{knowledge.name}/executions", ListExecutions, timeout=APPLY_LIMIT)
    if not listed.available():
        return []  # the original ROSPlan
    apply = ServiceProxy(f"{knowledge.name}/apply_effects", ApplyEffects, timeout=APPLY_LIMIT)
    settled = []
    for execution in listed(owner=rospy.get_name()).executions:
        token = Token.read(execution.token)
        if execution.operator_name.lower() != operator.lower() or not token.left_by_earlier(LIFE):
            continue
        answer = apply(
            operator_name=execution.operator_name,
            parameters=execution.parameters,
            phase=ApplyEffectsRequest.INTERRUPT,
            token=execution.token,
        )
        text = action_text(execution.operator_name, execution.parameters)
        if not answer.success:
            raise KnowledgeError(f"{text} of an earlier life cannot be settled: {answer.message}")
        if token.key is not None:
            settled.append(LeftExecution(token.key, text))
    return settled
