# SPDX-License-Identifier: Apache-2.0
"""Reads a whole knowledge base over ROS: ours, or ROSPlan's own."""

import threading
from collections import Counter
from typing import Any, Dict, List, Tuple

import rospy
from rosplan_knowledge_msgs.msg import DomainFormula, KnowledgeItem
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainAttributeService,
    GetDomainNameService,
    GetDomainTypeService,
    GetInstanceService,
    GetMetricService,
)

from merlin_pddl.domain import Domain, Signature
from merlin_pddl.formula import Variable
from merlin_pddl.knowledge import Fact, FunctionValue, Timed
from merlin_pddl.problem import Problem
from merlin_pddl.type_hierarchy import TypeCycleError
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader

LIMIT = 10.0  # s of wall time for one call


class KnowledgeBaseError(Exception):
    """The knowledge base does not answer, or with nonsense; the text says which."""


class KnowledgeSnapshots:
    """Reads domain and state of a knowledge base. Thread-safe.

    :param name: global name of the knowledge base.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._lock = threading.Lock()  # guards _domain
        self._domain: Dict[str, Domain] = {}
        services = {
            "domain/name": GetDomainNameService,
            "domain/types": GetDomainTypeService,
            "domain/predicates": GetDomainAttributeService,
            "domain/functions": GetDomainAttributeService,
            "state/instances": GetInstanceService,
            "state/propositions": GetAttributeService,
            "state/functions": GetAttributeService,
            "state/timed_knowledge": GetAttributeService,
            "state/goals": GetAttributeService,
            "state/metric": GetMetricService,
        }
        self._proxies = {
            suffix: ServiceProxy(f"{name}/{suffix}", kind, timeout=LIMIT) for suffix, kind in services.items()
        }

    def close(self) -> None:
        """Closes the connections."""
        for proxy in self._proxies.values():
            proxy.close()

    def _ask(self, suffix: str, *args: Any) -> Any:
        try:
            return self._proxies[suffix](*args)
        except ServiceError as error:
            raise KnowledgeBaseError(str(error)) from error

    def domain(self) -> Domain:
        """Types, predicates and functions; operators stay where they are.

        :raises KnowledgeBaseError: there is no usable answer.
        """
        stays = self._proxies["domain/types"].connected  # it keeps its domain as long as it lives
        name = self._ask("domain/name").domain_name
        with self._lock:
            if not stays or name not in self._domain:
                self._domain = {name: self._read_domain(name)}
            return self._domain[name]

    def _read_domain(self, name: str) -> Domain:
        domain = Domain(name)
        types = self._ask("domain/types")
        for type_name, parent in zip(types.types, types.super_types):
            domain.types.declare(type_name, [parent] if parent else [])
        try:
            domain.types.complete()
        except TypeCycleError as error:
            raise KnowledgeBaseError(f"{self.name}: {error}") from error
        domain.predicates = _signatures(self._ask("domain/predicates").items)
        domain.functions = _signatures(self._ask("domain/functions").items)
        for type_name in [*domain.types, "object"]:
            # What is listed with constants and not without them is one; an instance may have the same name.
            # Instances come and go meanwhile.
            before, both, after = (
                Counter(self._ask("state/instances", type_name, constants, False).instances)
                for constants in (False, True, False)
            )
            for constant in both - (before | after):
                domain.constants[constant.lower()] = (*domain.constants.get(constant.lower(), ()), type_name)
        return domain

    def snapshot(self) -> Tuple[Domain, Problem]:
        """Domain and everything that is stored. Several calls: a change in between may be half in it.

        :raises KnowledgeBaseError: there is no usable answer.
        """
        domain = self.domain()
        problem = Problem("task", domain.name)
        for type_name in dict.fromkeys([*domain.types, "object"]):
            for name in self._ask("state/instances", type_name, False, False).instances:
                if not domain.implies(name, type_name):
                    problem.objects[name] = (*problem.objects.get(name, ()), type_name)
        reader = KnowledgeReader(domain, keys=False)  # an original stores the keys as they were sent
        objects = problem.typed(domain.constants)
        try:
            facts = map(reader.item, self._ask("state/propositions", "").attributes)
            problem.facts = [item for item in facts if isinstance(item, Fact)]
            values = map(reader.item, self._ask("state/functions", "").attributes)
            problem.values = [item for item in values if isinstance(item, FunctionValue)]
            problem.timed = self._timed(reader)
            for message in self._ask("state/goals", "").attributes:
                goal = reader.goal(message, lambda: objects)
                if goal.instance is not None:
                    problem.instance_goals.append(goal.instance)
                elif goal.condition is not None:
                    problem.goals.append(goal.condition)
            metric = self._ask("state/metric").metric
            if metric.knowledge_type == KnowledgeItem.EXPRESSION:
                problem.metric = reader.metric(metric)
        except UpdateRefused as error:
            raise KnowledgeBaseError(f"{self.name} holds what cannot be read: {error}") from error
        return domain, problem

    def _timed(self, reader: KnowledgeReader) -> List[Timed]:
        now = rospy.get_rostime().to_nsec()
        rows = self._ask("state/timed_knowledge", "").attributes
        return [Timed(message.initial_time.to_nsec() - now, reader.item(message)) for message in rows]


def _signatures(formulas: List[DomainFormula]) -> Dict[str, Signature]:
    return {
        formula.name: Signature(
            formula.name, tuple(Variable(f"?{pair.key}", (pair.value,)) for pair in formula.typed_parameters)
        )
        for formula in formulas
    }
