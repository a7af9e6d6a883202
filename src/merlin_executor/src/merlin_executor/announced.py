# SPDX-License-Identifier: Apache-2.0
"""Waits for what announces itself on topics: the robots of the plan, and whatever a mission needs."""

import threading
from typing import Any, Callable, List, Optional, Sequence, Tuple

import rospy
from merlin_msgs.msg import RobotHost

from merlin_executor.core.awaited import Awaited
from merlin_planning.knowledge_client import KnowledgeClient, KnowledgeError, fact
from merlin_planning.planning_client import Interruptible
from merlin_ros.deadline import Deadline
from merlin_ros.late_topics import subscribe_by
from merlin_ros.robot_values import AVAILABLE, ROBOTS
from merlin_ros.service_proxy import ServiceError

PATIENCE = 5.0  # s of running time, after which the log says what is waited for


def robots_of_plan() -> List[str]:
    """The robots of ``robots:=``; empty: one robot without a name."""
    return [str(robot) for robot in rospy.get_param(ROBOTS, [])]


def knows_available(knowledge: KnowledgeClient) -> bool:
    """Whether the domain has the fact ``(available ?robot)``, which the bridges keep."""
    predicate = knowledge.predicates().get(AVAILABLE)
    return predicate is not None and len(predicate.typed_parameters) == 1


def missing_robots(
    knowledge: KnowledgeClient,
    robots: Sequence[str],
    timeout: float,
    waiting: str,
    interruptible: Interruptible = lambda _: None,
    one: bool = False,
) -> List[str]:
    """Waits until each robot takes actions and the knowledge says so, or its operator has taken it out.

    :param knowledge: of the domain; it has to be up already.
    :param timeout: s of running time for all of them.
    :param waiting: what the log says before their names.
    :param interruptible: is given what ends the wait early; no robot is missing then.
    :param one: the first robot that takes actions ends the wait early.
    :return: those that did not come, in the given order.
    """
    if not robots:
        return []
    known = knows_available(knowledge)
    awaited, interrupted = Awaited(robots), threading.Event()

    def heard(word: RobotHost) -> None:
        if word.leaving or word.robot not in robots:
            return
        try:
            there = word.out or not known or knowledge.query([fact(AVAILABLE, word.robot)])[0]
        except (KnowledgeError, ServiceError):
            return  # the next message of the host asks again
        if there:
            awaited.heard(word.robot)
            if one and not word.out:
                interrupt()

    def interrupt() -> None:
        interrupted.set()
        for robot in robots:
            awaited.heard(robot)

    interruptible(interrupt)
    try:
        topics = [(f"{knowledge.name}/robots", RobotHost, heard)]
        return wait_announced(waiting, awaited, topics, timeout, interrupted)
    finally:
        interruptible(None)


def wait_announced(
    waiting: str,
    awaited: Awaited,
    topics: Sequence[Tuple[str, type, Callable[[Any], None]]],
    timeout: float,
    interrupted: Optional[threading.Event] = None,
) -> List[str]:
    """Waits until all names were heard.

    :param waiting: what waits for which kind of thing; the log has it after :data:`PATIENCE`.
    :param topics: each with its type and a callback, which notes the names that it hears.
    :param timeout: s of running time for all of them.
    :param interrupted: ends the wait for a lost master; the names have to be noted, too.
    :return: the names that are missing in the end.
    """
    deadline = Deadline(timeout)
    subscribers = [subscribe_by(deadline, interrupted or threading.Event(), *topic) for topic in topics]
    missing = awaited.wait(Deadline(min(PATIENCE, timeout)).wait)
    if missing and not deadline.expired:
        rospy.logwarn(f"{waiting} {', '.join(missing)}, for {timeout:g} s in all")
        missing = awaited.wait(deadline.wait)
    for subscriber in subscribers:
        if subscriber is not None:
            subscriber.unregister()
    return missing
