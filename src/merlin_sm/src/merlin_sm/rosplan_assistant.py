# SPDX-License-Identifier: Apache-2.0
"""MerlinROSPlanAssistant: what the robot knows, for state machines (paper, section 3.2.1)."""

from typing import Iterable, List, Optional, Sequence, Tuple, Union

from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_pddl.text_reader import is_name, suggestion
from merlin_planning.knowledge_client import (
    ADD,
    ADD_GOAL,
    DEFAULT_KNOWLEDGE_BASE,
    REMOVE,
    REMOVE_GOAL,
    KnowledgeClient,
    KnowledgeError,
    Update,
    function_value,
    instance,
    knowledge_client,
)
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal, parse_literals, to_pddl

Facts = Union[str, Sequence[str]]


class MerlinROSPlanAssistant:
    """Creates, queries, updates and deletes knowledge.

    Facts are PDDL text, one or many: ``"(robot_at kitchen)"``. Every change is one transaction. Works on any
    ROSPlan knowledge base; the connection is made at the first call and shared by the whole process.

    All methods raise :class:`merlin_planning.knowledge_text.PDDLSyntaxError` for text that is not PDDL,
    :class:`merlin_planning.knowledge_client.KnowledgeError` for what the knowledge base refuses, and
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
        """The facts of a predicate, given by its name, as PDDL text; an empty one means all.

        :raises KnowledgeError: when the domain has no such predicate.
        """
        found = self.knowledge.propositions(_plain(predicate, "predicate"))
        if not found and predicate:
            self._check_known("predicate", predicate, self.knowledge.predicates())
        return [to_pddl(item) for item in found]

    def add_objects(self, type_name: str, *names: str) -> None:
        """Creates objects: ``add_objects("box_3 box_4 - box")``, or the type and then the names."""
        self.knowledge.update([Update(ADD, instance(*item)) for item in _declared(type_name, names)])

    def remove_objects(self, type_name: str, *names: str) -> None:
        """Deletes objects, with every fact that mentions them; written as in :meth:`add_objects`."""
        self.knowledge.update([Update(REMOVE, instance(*item)) for item in _declared(type_name, names)])

    def objects(self, type_name: str = "") -> List[str]:
        """The objects of a type and its subtypes, constants included; an empty type means all.

        :raises KnowledgeError: when the domain has no such type.
        """
        found = self.knowledge.instances(_plain(type_name, "type"))
        if not found and type_name.lower() not in ("", "object"):
            self._check_known("type", type_name, self.knowledge.types())
        return found

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
        """Assigns a numeric function: ``set_value("(battery)", value=20)``, or name and arguments."""
        name, terms = _function(function, arguments)
        self.knowledge.update([Update(ADD, function_value(name, terms, value))])

    def value(self, function: str, *arguments: str) -> Optional[float]:
        """The value of a numeric function, written as in :meth:`set_value`; None when it has none.

        :raises KnowledgeError: when the domain has no such function.
        """
        name, terms = _function(function, arguments)
        found = self.knowledge.functions(name)
        for item in found:
            if [entry.value.lower() for entry in item.values] == [text.lower() for text in terms]:
                return float(item.function_value)
        if not found:
            self._check_known("function", name, self.knowledge.function_signatures())
        return None

    @staticmethod
    def _check_known(kind: str, name: str, known: Iterable[str]) -> None:
        names = sorted(known)
        if name.lower() not in map(str.lower, names):
            listed = ", ".join(names) or "none"
            raise KnowledgeError(f"the domain has no {kind} {name!r}, only {listed}{suggestion(name, names)}")


def _texts(facts: Facts) -> Sequence[str]:
    return [facts] if isinstance(facts, str) else facts


def _plain(name: str, kind: str) -> str:
    """A name as such.

    :raises PDDLSyntaxError: for anything else, which would find nothing.
    """
    if name and not is_name(name):
        raise PDDLSyntaxError(f"{name!r} is not the name of a {kind}: without parentheses and arguments")
    return name


def _declared(text: str, names: Sequence[str]) -> List[Tuple[str, str]]:
    """Type and name of each object of a declaration.

    :raises PDDLSyntaxError: when it declares none.
    """
    if names:
        return [(_plain(text, "type"), name) for name in names]
    listed, dash, type_name = (part.strip() for part in text.partition(" - "))
    if not dash or not is_name(type_name) or not listed or not all(map(is_name, listed.split())):
        raise PDDLSyntaxError(
            f"{text!r} declares no object; write 'box_3 box_4 - box', or the type and names"
        )
    return [(type_name, name) for name in listed.split()]


def _function(text: str, arguments: Sequence[str]) -> Tuple[str, Sequence[str]]:
    """Name and arguments of a numeric function.

    :raises PDDLSyntaxError: when it is neither a name nor ``(name argument …)``.
    """
    if not text.lstrip().startswith("("):
        return _plain(text, "function"), arguments
    items = parse_literals([text]) if not arguments else []
    if len(items) != 1 or items[0].is_negative:
        raise PDDLSyntaxError(f"{text!r} is not a function; write '(battery)', or the name and its arguments")
    return items[0].attribute_name, [entry.value for entry in items[0].values]


def _goal_items(goals: Facts) -> List[KnowledgeItem]:
    return [item for text in _texts(goals) for item in parse_goal(text)]
