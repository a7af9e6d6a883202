"""What the parser and the dispatcher ask the knowledge base, over ROS, so that any ROSPlan knowledge base will do."""

import copy
from typing import Any, Dict, List, Sequence

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_sm.service_proxy import ServiceError, ServiceProxy
from rosplan_knowledge_msgs.msg import DomainInequality, KnowledgeItem
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainOperatorDetailsService,
    KnowledgeQueryService,
)

from merlin_rosplan.operator_model import Atom, Conditions, Operator
from merlin_rosplan.plan_graph import TimedLiteral


class KnowledgeError(Exception):
    """The knowledge base does not answer, or does not know; the text says what."""


class KnowledgeClient:
    """Asks one knowledge base; safe to share between threads.

    Parameters
    ----------
    knowledge_base: its global name.
    timeout: longest wait for an answer, s of wall time.
    """

    def __init__(self, knowledge_base: str, timeout: float = 5.0) -> None:
        self.name = knowledge_base
        self._operator = ServiceProxy(
            f"{knowledge_base}/domain/operator_details", GetDomainOperatorDetailsService, timeout
        )
        self._query = ServiceProxy(f"{knowledge_base}/query_state", KnowledgeQueryService, timeout)
        self._goals = ServiceProxy(f"{knowledge_base}/state/goals", GetAttributeService, timeout)
        self._timed = ServiceProxy(f"{knowledge_base}/state/timed_knowledge", GetAttributeService, timeout)

    def operator(self, name: str) -> Operator:
        """One operator of the domain.

        Raises
        ------
        KnowledgeError: there is none of that name, or no answer.
        """
        try:
            return Operator.from_message(self._operator(name=name).op)
        except ServiceError as error:
            if "does not answer" in str(error):
                raise KnowledgeError(str(error)) from error
            raise KnowledgeError(f"the domain has no operator '{name}' ({error})") from error

    def false_of(self, conditions: Conditions, binding: Dict[str, str]) -> Conditions:
        """Those conditions that do not hold now, asked in one call.

        A negative one holds when the positive fact is absent: ROSPlan's own knowledge base answers true for
        a negative query only when an explicit negative fact is stored.

        Parameters
        ----------
        conditions: ground atoms; comparisons are grounded here.
        binding: objects by operator variable.

        Raises
        ------
        KnowledgeError: no answer.
        """
        positive = [atom for atom in conditions.positive if atom.name != "="]
        negative = [atom for atom in conditions.negative if atom.name != "="]
        items = [fact_item(atom) for atom in positive + negative]
        items += [comparison_item(entry.message, binding) for entry in conditions.comparisons]
        results = self.query(items) if items else []
        holds = dict(zip(positive + negative, results))
        return Conditions(
            tuple(
                atom for atom in conditions.positive if not (_equal(atom) if atom.name == "=" else holds[atom])
            ),
            tuple(atom for atom in conditions.negative if (_equal(atom) if atom.name == "=" else holds[atom])),
            tuple(
                entry
                for entry, true in zip(conditions.comparisons, results[len(positive) + len(negative) :])
                if not true
            ),
        )

    def query(self, items: Sequence[KnowledgeItem]) -> List[bool]:
        """Whether each item is true now.

        Raises
        ------
        KnowledgeError: no answer.
        """
        try:
            answer = self._query(knowledge=list(items))
        except ServiceError as error:
            raise KnowledgeError(str(error)) from error
        if len(answer.results) != len(items):
            raise KnowledgeError(f"{self.name}/query_state gave {len(answer.results)} answers to {len(items)} items")
        return [bool(result) for result in answer.results]

    def unmet_goals(self) -> List[KnowledgeItem]:
        """The goals that do not hold now.

        Raises
        ------
        KnowledgeError: no answer.
        """
        try:
            goals = self._goals(predicate_name="").attributes
        except ServiceError as error:
            raise KnowledgeError(str(error)) from error
        if not goals:
            return []
        asked = []
        for goal in goals:
            item = copy.copy(goal)
            if goal.knowledge_type == KnowledgeItem.FACT:
                item.is_negative = False
            asked.append(item)
        return [
            goal
            for goal, true in zip(goals, self.query(asked))
            if true == (goal.knowledge_type == KnowledgeItem.FACT and goal.is_negative)
        ]

    def timed_literals(self) -> List[TimedLiteral]:
        """Facts that wait for their time; times in s from now. None where the service is missing.

        Raises
        ------
        KnowledgeError: no answer.
        """
        try:
            items = self._timed(predicate_name="").attributes
        except ServiceError as error:
            raise KnowledgeError(str(error)) from error
        now = rospy.Time.now()
        return [
            TimedLiteral(
                (item.initial_time - now).to_sec(),
                Atom(item.attribute_name, tuple(value.value for value in item.values)),
                bool(item.is_negative),
            )
            for item in items
            if item.knowledge_type == KnowledgeItem.FACT
        ]

    def close(self) -> None:
        """Closes the connections."""
        for proxy in (self._operator, self._query, self._goals, self._timed):
            proxy.close()


def fact_item(atom: Atom) -> KnowledgeItem:
    """A ground atom as a positive fact."""
    return KnowledgeItem(
        knowledge_type=KnowledgeItem.FACT,
        attribute_name=atom.name,
        values=[KeyValue(key=f"p{index}", value=value) for index, value in enumerate(atom.arguments)],
    )


def comparison_item(inequality: DomainInequality, binding: Dict[str, str]) -> KnowledgeItem:
    """A numeric condition with objects for the operator's variables."""
    ground = copy.deepcopy(inequality)
    ground.grounded = True
    for side in (ground.LHS, ground.RHS):
        for token in side.tokens:
            if token.expr_type == token.FUNCTION:
                for parameter in token.function.typed_parameters:
                    parameter.value = binding.get(parameter.key, parameter.key)
    return KnowledgeItem(knowledge_type=KnowledgeItem.INEQUALITY, ineq=ground)


def goal_text(goal: KnowledgeItem) -> str:
    """A goal as PDDL text, as far as it is a fact."""
    if goal.knowledge_type != KnowledgeItem.FACT:
        return "a numeric goal"
    fact: Any = Atom(goal.attribute_name, tuple(value.value for value in goal.values))
    return f"(not {fact})" if goal.is_negative else str(fact)


def _equal(atom: Atom) -> bool:
    return len({argument.lower() for argument in atom.arguments}) <= 1
