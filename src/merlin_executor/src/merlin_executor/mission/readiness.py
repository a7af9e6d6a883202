"""Waits until all parts of the robot that a mission needs are up."""

import threading
from typing import Any, Callable, List, Sequence, Tuple

import rospy
from actionlib_msgs.msg import GoalStatusArray
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_executor.core.awaited import Awaited
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_ros.deadline import Deadline
from merlin_ros.late_topics import subscribe_by
from merlin_sm.knowledge_client import KnowledgeClient

PATIENCE = 5.0  # s of running time, after which a mission says what it waits for


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
    awaited = Awaited(sorted(knowledge.operators()))
    topic = f"{knowledge.name}/pddl_action_parameters"
    return _wait(
        "the action interface of",
        awaited,
        [(topic, DomainFormula, lambda formula: awaited.heard(formula.name))],
        timeout,
    )


def missing_servers(names: Sequence[str], timeout: float) -> List[str]:
    """Waits for action servers.

    :param names: of the actions.
    :param timeout: s of running time for all of them.
    :return: the servers that published no status, in the given order.
    """
    awaited = Awaited(names)
    topics = [(f"{name}/status", GoalStatusArray, lambda _, name=name: awaited.heard(name)) for name in names]
    return _wait("the action server", awaited, topics, timeout)


def _wait(
    what: str, awaited: Awaited, topics: Sequence[Tuple[str, type, Callable[[Any], None]]], timeout: float
) -> List[str]:
    deadline, never = Deadline(timeout), threading.Event()
    subscribers = [subscribe_by(deadline, never, *topic) for topic in topics]
    missing = awaited.wait(Deadline(min(PATIENCE, timeout)))
    if missing and not deadline.expired:
        rospy.logwarn(f"the mission waits for {what} {', '.join(missing)}, for {timeout:g} s in all")
        missing = awaited.wait(deadline)
    for subscriber in subscribers:
        if subscriber is not None:
            subscriber.unregister()
    return missing
