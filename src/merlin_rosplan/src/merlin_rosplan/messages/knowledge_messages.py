# SPDX-License-Identifier: Apache-2.0
"""Knowledge items between ROSPlan's messages and the store."""

from typing import Callable, List, Mapping, Tuple, Union

import genpy
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import KnowledgeItem
from rosplan_knowledge_msgs.srv import KnowledgeUpdateServiceRequest as Request

from merlin_pddl.domain import Domain, Signature
from merlin_pddl.formula import Atom, Condition, Not
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Metric, StoredGoal, Timed
from merlin_pddl.problem_reader import parse_condition
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.transaction import Item, Transaction
from merlin_rosplan.messages.expression_messages import (
    ASSIGNMENT_NUMBERS,
    ASSIGNMENTS,
    FormulaWriter,
    by_name,
    by_position,
    read_comparison,
    read_expression,
)

#: Characters of an expression that is read: a million take about a second, and a robot waits for the answer.
MAX_EXPRESSION = 1_000_000

#: Gives all objects with their types; asked only when an item comes as text.
Objects = Callable[[], Mapping[str, Tuple[str, ...]]]


_CONDITIONS = (KnowledgeItem.EXPRESSION, KnowledgeItem.INEQUALITY)


class UpdateReader:
    """Applies updates, one by one, inside a transaction.

    :param domain: for items that come as PDDL text.
    :param objects: gives all objects with their types.
    :param strict: refuse what means nothing; else pass over it, as ROSPlan does.
    """

    def __init__(self, domain: Domain, objects: Objects, strict: bool) -> None:
        self._reader = KnowledgeReader(domain, keys=strict)
        self._objects = objects
        self._strict = strict

    def apply(self, transaction: Transaction, kind: int, message: KnowledgeItem) -> None:
        """Applies one update.

        :raises UpdateRefused: it is refused.
        """
        if kind in (Request.ADD_KNOWLEDGE, Request.REMOVE_KNOWLEDGE):
            adding = kind == Request.ADD_KNOWLEDGE
            if message.knowledge_type in _CONDITIONS and not (adding and self._strict):
                return  # a condition is not knowledge: ROSPlan does nothing with it
            item = self._reader.item(message)
            at = message.initial_time.to_nsec()
            (transaction.add if adding else transaction.remove)(item, at)
        elif kind == Request.ADD_GOAL:
            transaction.add_goal(self._reader.goal(message, self._objects))
        elif kind == Request.REMOVE_GOAL:
            transaction.remove_goal(self._reader.goal(message, self._objects))
        elif kind == Request.ADD_METRIC:
            transaction.set_metric(self._reader.metric(message))
        elif kind == Request.REMOVE_METRIC:
            transaction.set_metric(None)
        elif self._strict:
            raise UpdateRefused(f"there is no update_type {kind}")


class KnowledgeReader:
    """Reads the knowledge items of requests.

    :param domain: for goals and queries that come as PDDL text.
    :param keys: arguments are named by the declared keys, where they have them; else only their order counts.
    """

    def __init__(self, domain: Domain, keys: bool = True) -> None:
        self._domain = domain
        self._of_predicate = by_name(domain.predicates) if keys else by_position
        self._of_function = by_name(domain.functions) if keys else by_position

    def item(self, message: KnowledgeItem) -> Item:
        """An instance, fact or function value.

        :raises UpdateRefused: it is something else.
        """
        kind = message.knowledge_type
        if kind == KnowledgeItem.INSTANCE:
            return Instance(message.instance_type, message.instance_name)
        labels = tuple(pair.key for pair in message.values)
        since = message.initial_time.to_nsec()
        if kind == KnowledgeItem.FACT:
            args = self._of_predicate(message.attribute_name, message.values)
            return Fact(message.attribute_name, args, message.is_negative, since, labels)
        if kind == KnowledgeItem.FUNCTION:
            if message.assign_op not in ASSIGNMENTS:
                raise UpdateRefused(
                    f"assign_op {message.assign_op} of '{message.attribute_name}' cannot be applied at once"
                )
            op = ASSIGNMENTS[message.assign_op]
            args = self._of_function(message.attribute_name, message.values)
            return FunctionValue(message.attribute_name, args, message.function_value, since, op, labels)
        raise UpdateRefused(f"knowledge_type {kind} is not an instance, fact or function value")

    def goal(self, message: KnowledgeItem, objects: Objects) -> StoredGoal:
        """A goal: instance, fact, inequality, or an expression with PDDL text in `attribute_name`.

        :raises UpdateRefused: when its type is unknown, or it is malformed.
        """
        since = message.initial_time.to_nsec()
        if message.knowledge_type == KnowledgeItem.INSTANCE:
            return StoredGoal(None, Instance(message.instance_type, message.instance_name), since)
        return StoredGoal(self.condition(message, objects), None, since)

    def condition(self, message: KnowledgeItem, objects: Objects) -> Condition:
        """The condition that a fact, inequality or expression item states.

        :raises UpdateRefused: the item states none, or is malformed.
        """
        kind = message.knowledge_type
        if kind == KnowledgeItem.FACT:
            atom = Atom(message.attribute_name, self._of_predicate(message.attribute_name, message.values))
            return Not(atom) if message.is_negative else atom
        if kind == KnowledgeItem.INEQUALITY:
            comparison = read_comparison(message.ineq, self._of_function)
            return Not(comparison) if message.is_negative else comparison
        if kind == KnowledgeItem.EXPRESSION and message.attribute_name:
            if len(message.attribute_name) > MAX_EXPRESSION:
                raise UpdateRefused(
                    f"an expression of {len(message.attribute_name)} characters, more than {MAX_EXPRESSION}"
                )
            try:
                condition = parse_condition(message.attribute_name, self._domain, objects())
            except PddlError as error:
                raise UpdateRefused(f"'{message.attribute_name}': {error}") from error
            return Not(condition) if message.is_negative else condition
        raise UpdateRefused(f"an item with knowledge_type {kind} states no condition")

    def query(self, message: KnowledgeItem, objects: Objects) -> Union[Item, Condition]:
        """What `query_state` is asked by an item.

        :raises UpdateRefused: it is malformed.
        """
        if message.knowledge_type in (KnowledgeItem.INEQUALITY, KnowledgeItem.EXPRESSION):
            return self.condition(message, objects)
        if message.knowledge_type == KnowledgeItem.FUNCTION:
            args = self._of_function(message.attribute_name, message.values)
            return FunctionValue(message.attribute_name, args, 0.0)
        return self.item(message)

    def metric(self, message: KnowledgeItem) -> Metric:
        """A metric.

        :raises UpdateRefused: it is malformed.
        """
        return Metric(message.optimization, read_expression(message.expr, self._of_function))


class KnowledgeWriter:
    """Writes what the store holds as knowledge items."""

    def __init__(self, domain: Domain) -> None:
        self._domain = domain
        self._formulas = FormulaWriter(domain)

    def item(self, row: Item) -> KnowledgeItem:
        """An instance, fact or function value."""
        if isinstance(row, Instance):
            return KnowledgeItem(
                knowledge_type=KnowledgeItem.INSTANCE, instance_type=row.type_name, instance_name=row.name
            )
        message = KnowledgeItem(attribute_name=row.name, initial_time=_time(row.since))
        if isinstance(row, Fact):
            message.knowledge_type = KnowledgeItem.FACT
            message.is_negative = row.negative
            message.values = self._values(self._domain.predicates.get(row.name.lower()), row)
        else:
            message.knowledge_type = KnowledgeItem.FUNCTION
            message.function_value = row.value
            message.assign_op = ASSIGNMENT_NUMBERS[row.op]
            message.values = self._values(self._domain.functions.get(row.name.lower()), row)
        return message

    @staticmethod
    def _values(signature: Union[Signature, None], row: Union[Fact, FunctionValue]) -> List[KeyValue]:
        if signature is not None and len(signature.parameters) == len(row.args):
            return [KeyValue(p.label, arg) for p, arg in zip(signature.parameters, row.args)]
        labels = row.labels or tuple("" for _ in row.args)
        return [KeyValue(label, arg) for label, arg in zip(labels, row.args)]

    def timed(self, row: Timed) -> KnowledgeItem:
        """An item that waits for its time."""
        message = self.item(row.item)
        message.initial_time = _time(row.at)
        return message

    def goal(self, goal: StoredGoal) -> KnowledgeItem:
        """A goal. One that is neither literal nor comparison is an EXPRESSION with its text."""
        literal, comparison = goal.literal, goal.comparison
        if goal.instance is not None:
            message = self.item(goal.instance)
        elif literal is not None:
            message = self.item(Fact(literal[0].name, literal[0].args, literal[1]))
        elif comparison is not None:
            message = KnowledgeItem(
                knowledge_type=KnowledgeItem.INEQUALITY,
                is_negative=comparison[1],
                ineq=self._formulas.comparison(comparison[0]),
            )
        else:
            message = KnowledgeItem(knowledge_type=KnowledgeItem.EXPRESSION, attribute_name=goal.text())
        message.initial_time = _time(goal.since)
        return message

    def metric(self, metric: Union[Metric, None]) -> KnowledgeItem:
        """The metric; a default item when there is none, as in ROSPlan."""
        if metric is None:
            return KnowledgeItem()
        return KnowledgeItem(
            knowledge_type=KnowledgeItem.EXPRESSION,
            optimization=metric.optimization,
            expr=self._formulas.expression(metric.value),
        )


def _time(nanoseconds: int) -> genpy.Time:
    seconds, rest = divmod(max(0, nanoseconds), 1_000_000_000)
    return genpy.Time(min(seconds, 0xFFFFFFFF), rest)
