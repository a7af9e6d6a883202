"""Waits until all parts of the robot that a mission needs are up."""

import threading
from typing import List, Sequence

import rospy
from actionlib_msgs.msg import GoalStatusArray
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_ros.deadline import Deadline
from merlin_ros.late_topics import subscribe_by
from merlin_sm.knowledge_client import KnowledgeClient


class NotReady(RuntimeError):
    """A part of the robot is missing; the text says which."""


def wait_for_robot(
    knowledge: KnowledgeClient, client: MerlinExecutorClient, servers: Sequence[str], timeout: float
) -> None:
    """Waits for the knowledge base, the Executor, an action interface for every operator, and action servers.

    :param servers: names of the action servers.
    :param timeout: of each, s of running time.
    :raises NotReady: when one is missing.
    """
    after = f"after {timeout:.0f} s"
    if not knowledge.wait(timeout):
        raise NotReady(f"no knowledge base {knowledge.name} {after}")
    if not client.wait_for_executor(timeout):
        raise NotReady(f"no Executor on {client.name} {after}")
    missing = missing_interfaces(knowledge, timeout)
    if missing:
        raise NotReady(f"no action interface for {', '.join(missing)} {after}")
    missing = missing_servers(servers, timeout)
    if missing:
        names = ", ".join(map(rospy.resolve_name, missing))
        raise NotReady(f"no action server {names} {after}; is it launched?")


def missing_interfaces(knowledge: KnowledgeClient, timeout: float) -> List[str]:
    """Waits for an action interface for every operator.

    :param knowledge: of the domain; it has to be up already.
    :param timeout: s of running time.
    :return: the operators that no action interface announced, sorted.
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
    :return: the servers that published no status, in the given order.
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
