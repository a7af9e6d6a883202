"""MerlinROSPlanAssistant: what the robot knows, for state machines (paper, section 3.2.1)."""

from typing import List, Optional, Sequence, Union

from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_sm.knowledge_client import (
    ADD,
    ADD_GOAL,
    DEFAULT_KNOWLEDGE_BASE,
    REMOVE,
    REMOVE_GOAL,
    KnowledgeClient,
    Update,
    function_value,
    instance,
    knowledge_client,
)
from merlin_sm.knowledge_text import parse_goal, parse_literals, to_pddl

Facts = Union[str, Sequence[str]]


class MerlinROSPlanAssistant:
    """Creates, queries, updates and deletes knowledge.

    Facts are PDDL text, one or many: ``"(robot_at kitchen)"``. Every change is one transaction. Works on any
    ROSPlan knowledge base; the connection is made at the first call and shared by the whole process.

    All methods raise :class:`merlin_sm.knowledge_text.PDDLSyntaxError` for text that is not PDDL,
    :class:`merlin_sm.knowledge_client.KnowledgeError` for what the knowledge base refuses, and
    :class:`merlin_ros.service_proxy.ServiceError` when it does not answer.
    """

    knowledge_base = DEFAULT_KNOWLEDGE_BASE

    @property
    def knowledge(self) -> KnowledgeClient:
        """The client of the knowledge base."""
        return knowledge_client(self.knowledge_base)

    def add_facts(self, facts: Facts) -> None:
        """Makes facts true; ``(not (p))`` makes p false."""
        self.change_facts(add=facts)

    def remove_facts(self, facts: Facts) -> None:
        """Makes facts false."""
        self.change_facts(remove=facts)

    def change_facts(self, add: Facts = (), remove: Facts = ()) -> None:
        """Removes, then adds, in one transaction."""
        updates = [Update(REMOVE, item) for item in parse_literals(_texts(remove))]
        for item in parse_literals(_texts(add)):
            kind = REMOVE if item.is_negative else ADD
            item.is_negative = False
            updates.append(Update(kind, item))
        self.knowledge.update(updates)

    def holds(self, condition: str) -> bool:
        """Whether a condition (literals, comparisons, ``and``) is true now."""
        return all(self.knowledge.query(parse_goal(condition)))

    def facts(self, predicate: str = "") -> List[str]:
        """The facts of a predicate as PDDL text; an empty one means all."""
        return [to_pddl(item) for item in self.knowledge.propositions(predicate)]

    def add_objects(self, type_name: str, *names: str) -> None:
        """Creates objects of a type."""
        self.knowledge.update([Update(ADD, instance(type_name, name)) for name in names])

    def remove_objects(self, type_name: str, *names: str) -> None:
        """Deletes objects, with every fact that mentions them."""
        self.knowledge.update([Update(REMOVE, instance(type_name, name)) for name in names])

    def objects(self, type_name: str = "") -> List[str]:
        """The objects of a type and its subtypes, constants included; an empty type means all."""
        return self.knowledge.instances(type_name)

    def add_goals(self, goals: Facts) -> None:
        """Adds goals."""
        self.knowledge.update([Update(ADD_GOAL, item) for item in _goal_items(goals)])

    def remove_goals(self, goals: Facts) -> None:
        """Removes goals."""
        self.knowledge.update([Update(REMOVE_GOAL, item) for item in _goal_items(goals)])

    def goals(self) -> List[str]:
        """All goals as PDDL text."""
        return [to_pddl(item) for item in self.knowledge.goals()]

    def set_value(self, function: str, *arguments: str, value: float) -> None:
        """Assigns a numeric function."""
        self.knowledge.update([Update(ADD, function_value(function, arguments, value))])

    def value(self, function: str, *arguments: str) -> Optional[float]:
        """The value of a numeric function; None when it has none."""
        for item in self.knowledge.functions(function):
            if [entry.value.lower() for entry in item.values] == [text.lower() for text in arguments]:
                return float(item.function_value)
        return None


def _texts(facts: Facts) -> Sequence[str]:
    return [facts] if isinstance(facts, str) else facts


def _goal_items(goals: Facts) -> List[KnowledgeItem]:
    return [item for text in _texts(goals) for item in parse_goal(text)]
