"""Messages for the knowledge base, and its topics, as ROSPlan's clients write and read them."""

import threading

import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, ExprComposite
from rosplan_knowledge_msgs.msg import KnowledgeItem as Item
from topic_links import wait_for_publishers

LONG = 60.0
KB = "rosplan_knowledge_base"


def call(name, service_class, *args, base=KB):
    return rospy.ServiceProxy(f"{base}/{name}", service_class)(*args)


def fact(name, *args, negative=False, at=0.0):
    values = [KeyValue("some text", arg) for arg in args]
    return Item(
        knowledge_type=Item.FACT,
        attribute_name=name,
        values=values,
        is_negative=negative,
        initial_time=rospy.Time.from_sec(at),
    )


def instance(kind, name):
    return Item(knowledge_type=Item.INSTANCE, instance_type=kind, instance_name=name)


def travel_time(origin, goal, value=0.0):
    item = fact("travel_time", origin, goal)
    item.knowledge_type, item.function_value = Item.FUNCTION, value
    return item


def number(value):
    return ExprComposite([ExprBase(expr_type=ExprBase.CONSTANT, constant=value)])


def function(name, *args):
    formula = DomainFormula(name, [KeyValue("", arg) for arg in args])
    return [ExprBase(expr_type=ExprBase.FUNCTION, function=formula)]


def operator(op):
    return [ExprBase(expr_type=ExprBase.OPERATOR, op=op)]


def comparison(kind, left, right):
    return Item(knowledge_type=Item.INEQUALITY, ineq=DomainInequality(kind, left, right, False))


class Received:
    """The messages of a topic."""

    def __init__(self, name, kind, publishers=1):
        self.messages = []
        self._arrived = threading.Condition()
        self._subscriber = rospy.Subscriber(name, kind, self._receive)
        wait_for_publishers(self._subscriber, count=publishers)

    def _receive(self, message):
        with self._arrived:
            self.messages.append(message)
            self._arrived.notify_all()

    def wait(self, predicate):
        with self._arrived:
            assert self._arrived.wait_for(lambda: any(map(predicate, self.messages)), LONG), self.messages
            return next(message for message in self.messages if predicate(message))

    def close(self):
        self._subscriber.unregister()
