"""Tells a mission when those are there who carry its goals out: action interfaces and action servers."""

import threading
from typing import List, Sequence

import rospy
from actionlib_msgs.msg import GoalStatusArray
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_sm.deadline import Deadline
from merlin_sm.knowledge_client import KnowledgeClient


def missing_interfaces(knowledge: KnowledgeClient, timeout: float) -> List[str]:
    """Waits for an action interface for every operator.

    :param knowledge: of the domain; it has to answer already.
    :param timeout: s of running time.
    :return: the operators that nobody announced, sorted.
    """
    missing = set(knowledge.operators())
    announced = threading.Condition()  # guards missing

    def receive(formula: DomainFormula) -> None:
        with announced:
            missing.discard(formula.name)
            announced.notify_all()

    subscriber = rospy.Subscriber(f"{knowledge.name}/pddl_action_parameters", DomainFormula, receive)
    with announced:
        Deadline(timeout).wait(announced, lambda: not missing)
        left = sorted(missing)
    subscriber.unregister()
    return left


def missing_servers(names: Sequence[str], timeout: float) -> List[str]:
    """Waits for action servers.

    :param names: of the actions.
    :param timeout: s of running time for all of them.
    :return: those of which nothing was heard, in the given order.
    """
    heard = set()
    changed = threading.Condition()  # guards heard

    def receive(_: GoalStatusArray, name: str) -> None:
        with changed:
            heard.add(name)
            changed.notify_all()

    subscribers = [rospy.Subscriber(f"{name}/status", GoalStatusArray, receive, name) for name in names]
    with changed:
        Deadline(timeout).wait(changed, lambda: len(heard) == len(set(names)))
        left = [name for name in names if name not in heard]
    for subscriber in subscribers:
        subscriber.unregister()
    return left
