# SPDX-License-Identifier: Apache-2.0
"""Messages for the knowledge base, and its topics, as ROSPlan's clients write and read them."""

import threading
from typing import Any, Callable, List

import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, ExprComposite
from rosplan_knowledge_msgs.msg import KnowledgeItem as Item

from merlin_test import LONG
from merlin_test.topic_links import wait_for_publishers

KB = "rosplan_knowledge_base"


def call(name: str, service_class: type, *args: Any, base: str = KB) -> Any:
    return rospy.ServiceProxy(f"{base}/{name}", service_class)(*args)


def fact(name: str, *args: str, negative: bool = False, at: float = 0.0) -> Item:
    values = [KeyValue("some text", arg) for arg in args]
    return Item(
        knowledge_type=Item.FACT,
        attribute_name=name,
        values=values,
        is_negative=negative,
        initial_time=rospy.Time.from_sec(at),
    )


def instance(kind: str, name: str) -> Item:
    return Item(knowledge_type=Item.INSTANCE, instance_type=kind, instance_name=name)


def travel_time(origin: str, goal: str, value: float = 0.0) -> Item:
    item = fact("travel_time", origin, goal)
    item.knowledge_type, item.function_value = Item.FUNCTION, value
    return item


def number(value: float) -> ExprComposite:
    return ExprComposite([ExprBase(expr_type=ExprBase.CONSTANT, constant=value)])


def function(name: str, *args: str) -> List[ExprBase]:
    formula = DomainFormula(name, [KeyValue("", arg) for arg in args])
    return [ExprBase(expr_type=ExprBase.FUNCTION, function=formula)]


def operator(op: int) -> List[ExprBase]:
    return [ExprBase(expr_type=ExprBase.OPERATOR, op=op)]


def comparison(kind: int, left: ExprComposite, right: ExprComposite) -> Item:
    return Item(knowledge_type=Item.INEQUALITY, ineq=DomainInequality(kind, left, right, False))


class Received:
    """The messages of a topic."""

    def __init__(self, name: str, kind: type, publishers: int = 1) -> None:
        self.messages: List[Any] = []
        self._arrived = threading.Condition()
        self._subscriber = rospy.Subscriber(name, kind, self._receive)
        wait_for_publishers(self._subscriber, count=publishers)

    def _receive(self, message: Any) -> None:
        with self._arrived:
            self.messages.append(message)
            self._arrived.notify_all()

    def wait(self, predicate: Callable[[Any], bool]) -> Any:
        with self._arrived:
            assert self._arrived.wait_for(lambda: any(map(predicate, self.messages)), LONG), self.messages
            return next(message for message in self.messages if predicate(message))

    def close(self) -> None:
        self._subscriber.unregister()
