"""Tells a mission when every operator of the domain has somebody who carries it out."""

import threading
from typing import List

import rospy
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
