"""Tells a mission when those are there who carry its goals out: action interfaces and action servers."""

import threading
from typing import List, Sequence

from actionlib_msgs.msg import GoalStatusArray
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_ros.deadline import Deadline
from merlin_ros.late_topics import subscribe_by
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

    deadline = Deadline(timeout)
    topic = f"{knowledge.name}/pddl_action_parameters"
    subscriber = subscribe_by(deadline, threading.Event(), topic, DomainFormula, receive)
    with announced:
        deadline.wait(announced, lambda: not missing)
        left = sorted(missing)
    if subscriber is not None:
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

    def receive(name: str) -> None:
        with changed:
            heard.add(name)
            changed.notify_all()

    deadline, never = Deadline(timeout), threading.Event()
    subscribers = [
        subscribe_by(deadline, never, f"{name}/status", GoalStatusArray, lambda _, name=name: receive(name))
        for name in names
    ]
    with changed:
        deadline.wait(changed, lambda: len(heard) == len(set(names)))
        left = [name for name in names if name not in heard]
    for subscriber in subscribers:
        if subscriber is not None:
            subscriber.unregister()
    return left
