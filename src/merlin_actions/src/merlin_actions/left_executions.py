# SPDX-License-Identifier: Apache-2.0
"""Settles what an earlier process of this node has begun and left open in the knowledge base."""

from typing import List, NamedTuple

import rospy

from merlin_actions.core.execution import Key, Token
from merlin_actions.effects import APPLY_LIMIT
from merlin_planning.execution_journal import ExecutionJournal
from merlin_planning.knowledge_client import KnowledgeClient, KnowledgeError
from merlin_planning.knowledge_text import action_text
from merlin_ros.actions.lease_holder import LIFE


class LeftExecution(NamedTuple):
    """An execution that was settled."""

    key: Key
    text: str


def settle_left(knowledge: KnowledgeClient, operator: str) -> List[LeftExecution]:
    """Closes the open executions of an operator that an earlier process of this node has left.

    Nothing of them continues: their state machines have lost their owner.

    :raises KnowledgeError: when the knowledge base refuses.
    :raises merlin_ros.service_proxy.ServiceError: when it does not answer.
    """
    journal = ExecutionJournal(knowledge.name, APPLY_LIMIT)
    if not journal.offered():
        return []  # the original ROSPlan
    settled = []
    for execution in journal.open(rospy.get_name()):
        token = Token.read(execution.token)
        if execution.operator_name.lower() != operator.lower() or not token.left_by_earlier(LIFE):
            continue
        refused = journal.interrupt(execution)
        text = action_text(execution.operator_name, execution.parameters)
        if refused:
            raise KnowledgeError(f"{text} of an earlier process cannot be settled: {refused}")
        if token.key is not None:
            settled.append(LeftExecution(token.key, text))
    return settled
