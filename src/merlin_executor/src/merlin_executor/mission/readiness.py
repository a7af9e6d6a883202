# SPDX-License-Identifier: Apache-2.0
"""Waits until all parts of the robot that a mission needs are up."""

from typing import List, Optional, Sequence

import rospy
from actionlib_msgs.msg import GoalStatusArray
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_executor.announced import missing_robots, robots_of_plan, wait_announced
from merlin_executor.core.awaited import Awaited
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.mission.literal_goals import goal_faults_now
from merlin_planning.knowledge_client import KnowledgeClient


class NotReady(RuntimeError):
    """A part of the robot is missing; the text says which."""


def wait_for_robot(
    knowledge: KnowledgeClient,
    client: MerlinExecutorClient,
    mission: Optional[type],
    servers: Sequence[str],
    timeout: float,
) -> None:
    """Waits for the knowledge base, the Executor, an action interface for every operator, robots and servers.

    Of the robots of ``robots:=`` those that do not come in time are left out, while there is one: a plan goes
    on without them, too.

    :param servers: names of the action servers; of several robots each has those whose names have no slash.
    :param mission: whose literal goals are compared with the domain; None: there is no class of one.
    :param timeout: of each, s of running time.
    :raises NotReady: when one is missing, or a goal is not known.
    """
    after = f"after {timeout:.0f} s"
    if not knowledge.wait(timeout):
        raise NotReady(f"no knowledge base {knowledge.name} {after}")
    faults = goal_faults_now(mission, knowledge) if mission is not None else []
    if faults:
        raise NotReady("; ".join(faults))
    if not client.wait_for_executor(timeout):
        raise NotReady(f"no Executor on {client.name} {after}")
    missing = missing_interfaces(knowledge, timeout)
    if missing:
        raise NotReady(f"no action interface for {', '.join(missing)} {after}")
    robots = robots_of_plan()
    gone = missing_robots(knowledge, robots, timeout, "the mission waits for the robots")
    if robots and len(gone) == len(robots):
        raise NotReady(f"no host of the robots {', '.join(gone)} takes actions {after}; are they launched?")
    if gone and not rospy.is_shutdown():
        rospy.logwarn(f"the mission begins without {', '.join(gone)}, which did not come {after}")
    there = [robot for robot in robots if robot not in gone]
    missing = missing_servers(servers_of(servers, there), timeout)
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
    return wait_announced(
        "the mission waits for the action interface of",
        awaited,
        [(topic, DomainFormula, lambda formula: awaited.heard(formula.name))],
        timeout,
    )


def servers_of(names: Sequence[str], robots: Sequence[str]) -> List[str]:
    """Action servers of a mission: with several robots a name without a slash is one of each of them."""
    each = [
        [name] if "/" in name or not robots else [f"{robot}/{name}" for robot in robots] for name in names
    ]
    return [server for servers in each for server in servers]


def missing_servers(names: Sequence[str], timeout: float) -> List[str]:
    """Waits for action servers.

    :param names: of the actions.
    :param timeout: s of running time for all of them.
    :return: the servers that published no status, in the given order.
    """
    awaited = Awaited(names)
    topics = [  # an action is remapped by its own name, which is not that of its topics
        (f"{rospy.resolve_name(name)}/status", GoalStatusArray, lambda _, name=name: awaited.heard(name))
        for name in names
    ]
    return wait_announced("the mission waits for the action server", awaited, topics, timeout)
