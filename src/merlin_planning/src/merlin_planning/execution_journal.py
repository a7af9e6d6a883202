# SPDX-License-Identifier: Apache-2.0
"""The executions that are open in a knowledge base, and their end when what carried them out is gone."""

from typing import List

from merlin_msgs.msg import OpenExecution
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest, ListExecutions
from rosplan_knowledge_msgs.srv import KnowledgeUpdateServiceArray

from merlin_pddl.plan_text import call_text
from merlin_ros.service_proxy import ServiceProxy, ServiceUnavailable


def execution_text(execution: OpenExecution) -> str:
    """The ground action as PDDL text."""
    return call_text(execution.operator_name, [parameter.value for parameter in execution.parameters])


class ExecutionJournal:
    """A client of a knowledge base's journal of executions. The original ROSPlan has no journal.

    :param knowledge_base: its name.
    :param timeout: s of wall time for one call.
    """

    def __init__(self, knowledge_base: str, timeout: float) -> None:
        self._list = ServiceProxy(f"{knowledge_base}/executions", ListExecutions, timeout=timeout)
        self._apply = ServiceProxy(f"{knowledge_base}/apply_effects", ApplyEffects, timeout=timeout)
        self._update = ServiceProxy(f"{knowledge_base}/update_array", KnowledgeUpdateServiceArray)

    def available(self) -> bool:
        """Whether the knowledge base has a journal, and takes calls now."""
        return self._list.available()

    def offered(self) -> bool:
        """Whether the knowledge base is one with a journal, though it may be too busy to answer now.

        :raises merlin_ros.service_proxy.ServiceError: when it is not known: the master gives no answer, or
            the knowledge base is not there.
        """
        if self._list.offered():
            return True
        if not self._update.available():
            raise ServiceUnavailable(f"service {self._update.name} does not answer: nothing offers it")
        return False

    def open(self, owner: str = "") -> List[OpenExecution]:
        """The open executions.

        :param owner: node that has begun them; empty: every node.
        :raises merlin_ros.service_proxy.ServiceError: when the knowledge base does not answer.
        """
        return list(self._list(owner=owner).executions)

    def interrupt(self, execution: OpenExecution) -> str:
        """Closes an execution as interrupted; a second time changes nothing.

        :return: why the knowledge base refuses; empty when it is closed.
        :raises merlin_ros.service_proxy.ServiceError: when the knowledge base does not answer.
        """
        answer = self._apply(
            operator_name=execution.operator_name,
            parameters=execution.parameters,
            phase=ApplyEffectsRequest.INTERRUPT,
            token=execution.token,
        )
        return "" if answer.success else str(answer.message)
