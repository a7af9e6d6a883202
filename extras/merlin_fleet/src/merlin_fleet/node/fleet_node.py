# SPDX-License-Identifier: Apache-2.0
"""Node: this robot's part in a fleet."""

import contextlib
import math
import os
import signal
import uuid
from typing import Callable, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from sensor_msgs.msg import BatteryState

from merlin_executor.executor_client import CANCEL, MerlinExecutorClient
from merlin_executor.node.guard_client import GuardClient
from merlin_fleet.certified import HubError
from merlin_fleet.core.agent import Agent
from merlin_fleet.core.records import SCHEMAS, Profile, Schema
from merlin_fleet.fleet_robot import FleetRobot, FleetStatus
from merlin_fleet.hub import EtcdHub
from merlin_fleet.node.executor_body import NO_EXECUTOR, ExecutorBody
from merlin_fleet.node.fleet_parameters import FleetParameters, read_parameters
from merlin_fleet.node.planned_cost import PlannedCost, RobotDomain
from merlin_fleet.node.robot_report import RobotReport
from merlin_fleet.node.shared_knowledge import OBJECTS, SharedKnowledge
from merlin_fleet.sqlite_outbox import OutboxError, SqliteOutbox
from merlin_pddl.text_reader import PddlError
from merlin_planning.knowledge_client import DEFAULT_KNOWLEDGE_BASE, knowledge_client
from merlin_ros.health import ERROR, OK, WARN, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import graph_name
from merlin_rosplan.messages.knowledge_snapshot import KnowledgeBaseError, KnowledgeSnapshots
from merlin_rosplan.planning.planner import PlannerSettings

NAME = "merlin_fleet"
RUNNING = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING)
#: What the domain of a knowledge base that is not there raises.
NO_DOMAIN = (KnowledgeBaseError, OSError, PddlError)
CLOSE_LIMIT = 7.0  # s for what runs to stop; a node has 10 s to end


class NotThere(Exception):
    """The planning system does not run yet; the text names the missing part."""


class Battery:
    """The robot's battery, as its driver publishes it.

    :param topic: of sensor_msgs/BatteryState; empty: it is not looked at.
    :param least: share of its charge below which the robot takes nothing.
    """

    def __init__(self, topic: str, least: float) -> None:
        self._least = least
        self._topic = topic
        self._charge: Optional[float] = None
        if topic:
            rospy.Subscriber(topic, BatteryState, self._receive, queue_size=1)

    def unfit(self) -> str:
        """Why the robot takes nothing; empty: it does."""
        if not self._topic:
            return ""
        if self._charge is None:
            return f"its battery was not received on {self._topic}"
        low = self._charge < self._least
        return f"its battery is at {self._charge:.0%}, less than {self._least:.0%}" if low else ""

    def _receive(self, message: BatteryState) -> None:
        self._charge = None if math.isnan(message.percentage) else message.percentage


class Occupation:
    """Whether the Executor has something to do, for the fleet or not.

    :param action: name of its action.
    """

    def __init__(self, action: str) -> None:
        self._busy = False
        rospy.Subscriber(f"{action}/status", GoalStatusArray, self._receive, queue_size=1)

    def busy(self) -> bool:
        """Whether the Executor runs a request, of any client."""
        return self._busy

    def _receive(self, message: GoalStatusArray) -> None:
        self._busy = any(status.status in RUNNING for status in message.status_list)


class FleetNode:
    """Joins the parts: hub, agent, body and health.

    :raises NotThere: when the knowledge base does not run in time.
    :raises HubError: for an address or certificates that cannot be used.
    :raises OutboxError: for a file that cannot be used.
    """

    def __init__(self, parameters: FleetParameters) -> None:
        self._parameters = parameters
        self._status = FleetStatus()
        knowledge_base = rospy.resolve_name(graph_name("~knowledge_base", DEFAULT_KNOWLEDGE_BASE))
        # The Executor checks the goals itself, as it does for every client.
        self._client = MerlinExecutorClient(knowledge_base=None, on_client_lost=CANCEL)
        busy = Occupation(self._client.name).busy
        self._domain, self._costs = _planned_cost(knowledge_base, parameters, busy)
        battery = Battery(parameters.battery, parameters.battery_least)
        body = ExecutorBody(
            self._client,
            self._costs,
            GuardClient(knowledge_base).halt,
            parameters.rules.lease.stop_time,
            parameters.priority,
            lambda: battery.unfit() or self._report.unfit(),
        )
        profile = Profile(parameters.robot, parameters.groups, parameters.capabilities, self._domain.identity)
        outbox = SqliteOutbox(parameters.outbox)
        rules, life = parameters.rules, uuid.uuid4().hex
        agent = Agent(parameters.fleet, profile, life, outbox, rules, fleet_id=outbox.fleet_id)
        hub = EtcdHub(agent.keys.root, parameters.endpoints, parameters.tls, end=agent.keys.robots_end)
        own = [name for name, writer in rules.facts.items() if writer == parameters.robot]
        self._knowledge = SharedKnowledge(
            knowledge_client(knowledge_base), own, lambda *known: self._know(*known), rospy.logwarn
        )
        self._report = RobotReport(
            self._client.name,
            lambda: self._client.executor_alive,
            parameters.page,
            lambda *said: self._robot.tell(*said),
        )
        self._robot = FleetRobot(
            agent,
            hub,
            body,
            rospy.logwarn,
            note_fleet=outbox.note_fleet,
            on_status=self._take,
            learn=self._knowledge.learn,
            on_failed=lambda error: _begin_anew(f"it has failed:\n{error}"),
            on_halt=self._report.halt,
        )

    def start(self) -> None:
        """Begins, whether there is a hub or not."""
        rospy.on_shutdown(self._close)
        HealthReporter({"fleet": self.health}).start()
        self._robot.start()
        self._knowledge.start()
        self._report.start()

    def health(self) -> Health:
        """How the robot stands in its fleet."""
        status, parameters = self._status, self._parameters
        values = {
            "fleet": parameters.fleet,
            "hub": ", ".join(parameters.endpoints),
            "goals": ", ".join(status.owned),
            "not reported": status.unreported,
            "old facts": "; ".join(status.stale),
        }
        if status.refused:
            return Health(ERROR, status.refused, values)
        if not self._client.executor_alive:
            return Health(WARN, NO_EXECUTOR, values)
        if not status.connected:
            return Health(WARN, "without the hub; it works for itself", values)
        if not status.joined:
            return Health(WARN, "not joined yet", values)
        if status.clock:
            return Health(WARN, f"{status.clock}; it takes no goals with a deadline", values)
        if status.stale:
            return Health(WARN, f"it plans with old facts: {'; '.join(status.stale)}", values)
        return Health(OK, "joined", values)

    def _know(self, predicate: str, facts: Optional[Tuple[str, ...]], version: int) -> None:
        if predicate != OBJECTS:
            self._robot.know(predicate, facts, version)
        elif facts is not None:
            with contextlib.suppress(*NO_DOMAIN):  # the knowledge base ends; the next one is looked at
                if self._domain.replaced():
                    _begin_anew("its knowledge base has another domain")
            self._robot.tell(SCHEMAS, Schema(self._domain.vocabulary, facts))

    def _take(self, status: FleetStatus) -> None:
        before, self._status = self._status, status
        if status.joined and not before.joined:
            rospy.loginfo(f"the robot '{self._parameters.robot}' is in the fleet '{self._parameters.fleet}'")

    def _close(self) -> None:
        self._costs.close()
        self._knowledge.close()
        self._report.close()
        self._robot.close(CLOSE_LIMIT)


def _begin_anew(why: str) -> None:
    """Ends the node as a signal to it alone does: what runs is cancelled, and it is started again."""
    rospy.logfatal(f"the robot's part in the fleet begins anew: {why}")
    os.kill(os.getpid(), signal.SIGTERM)


def _planned_cost(
    knowledge_base: str, parameters: FleetParameters, busy: Callable[[], bool]
) -> Tuple[RobotDomain, PlannedCost]:
    """The robot's domain, and what plans in it."""
    wait = parameters.start_wait
    if not knowledge_client(knowledge_base).wait(wait):
        raise NotThere(f"the knowledge base {knowledge_base} does not run after {wait:g} s; is it launched?")
    snapshots = KnowledgeSnapshots(knowledge_base)
    try:
        domain = RobotDomain(snapshots, lambda: str(rospy.get_param(f"{knowledge_base}/domain_path", "")))
    except NO_DOMAIN as error:
        raise NotThere(f"the domain of {knowledge_base} cannot be read: {error}") from None
    settings = PlannerSettings(command=parameters.planner_command, time_limit=parameters.planning_time)
    times = parameters.action_duration, parameters.goal_duration
    return domain, PlannedCost(snapshots, domain.path, settings, *times, busy)


def _start() -> None:
    FleetNode(read_parameters()).start()


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node(NAME, _start, HubError, OutboxError, missing=(NotThere,))
