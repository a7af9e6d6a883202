# SPDX-License-Identifier: Apache-2.0
"""Node: the bridges (:class:`MerlinAction`) of all actions in one process."""

import functools
import math
from typing import Any, Callable, Dict, List, Optional, Sequence

import rospy

from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.names import by_ros_name
from merlin_actions.core.robot_book import GONE_AFTER, WORD_PERIOD
from merlin_actions.merlin_action import MerlinAction
from merlin_actions.robot_places import RobotPlaces
from merlin_actions.robot_watch import RobotWatch
from merlin_actions.shutdown_order import shut_down
from merlin_actions.stopped_robots import StoppedRobots
from merlin_planning.knowledge_client import (
    DEFAULT_KNOWLEDGE_BASE,
    KnowledgeBaseMissing,
    KnowledgeError,
    knowledge_client,
    wait_for_knowledge_base,
)
from merlin_ros.health import OK, WARN, Health, HealthReporter
from merlin_ros.node import on_master_lost, run_node
from merlin_ros.parameters import ParameterError, flag, graph_name, number


def make_bridges(
    operators: List[str], knowledge_base: str, robots: Optional[RobotWatch] = None
) -> List[MerlinAction]:
    """Makes a bridge for each operator, with the limits of this node's parameters.

    :param operators: names; none: every operator of the domain.
    :param robots: on which the actions run that have a parameter of type ``robot``; None: all run here.
    :raises ValueError: when two of them map to one ROS name.
    :raises KnowledgeError: when the domain lacks one.
    :raises ParameterError: when a limit is not a number.
    """
    names = operators or list(knowledge_client(knowledge_base).operators())
    by_ros_name(names)
    options: Dict[str, Any] = {
        key: graph_name(f"~{key}")
        for key in ("dispatch_topic", "feedback_topic")
        if rospy.has_param(f"~{key}")
    }
    for key in ("server_wait", "cancel_limit", "run_limit"):
        if rospy.has_param(f"~{key}"):
            options[key] = number(f"~{key}", 0.0, -math.inf)
    if robots is not None:
        places = RobotPlaces()
        options["stopped"] = StoppedRobots(knowledge_client(knowledge_base), places.points_at)
    return [MerlinAction(name, knowledge_base=knowledge_base, robots=robots, **options) for name in names]


def robots_health(robots: RobotWatch, bridges: Sequence[ActionInterface]) -> Health:
    """Which robot does what; a warning where one takes no actions, with the reason."""
    does: Dict[str, str] = {}
    for execution in (execution for bridge in bridges for execution in bridge.executions()):
        if execution.left_queue.is_set():
            does[execution.lane] = execution.text
    why = robots.why_not_each()
    said = {robot: reason or does.get(robot, "waits") for robot, reason in why.items()}
    text = "; ".join(f"{robot}: {words}" for robot, words in said.items())
    return Health(WARN if any(why.values()) else OK, text or "no host of a robot was heard", said)


def main() -> int:
    """Runs the node; returns the exit code."""
    missing = (KnowledgeBaseMissing, rospy.ServiceException)
    return run_node("merlin_bridges", _start, KnowledgeError, ValueError, missing=missing)


def _start() -> None:
    knowledge_base = graph_name("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
    wait_for_knowledge_base(knowledge_base, number("~knowledge_base_wait", 30.0, 0.0))
    gone_after = number("~gone_after", GONE_AFTER, WORD_PERIOD)
    robots = RobotWatch(knowledge_client(knowledge_base), gone_after) if flag("~robots") else None
    operators = rospy.get_param("~operators", [])
    if not isinstance(operators, list):
        raise ParameterError(f"parameter ~operators is {operators!r}, not a list of operators")
    bridges = make_bridges(operators, knowledge_base, robots)
    started: List[MerlinAction] = []
    rospy.on_shutdown(functools.partial(shut_down, started))
    for bridge in bridges:
        bridge.start()
        started.append(bridge)
        on_master_lost(bridge.master_lost)
        if robots is not None:
            robots.listen(bridge.robot_changed)
    checks: Dict[str, Callable[[], Health]] = {bridge.operator: bridge.health for bridge in bridges}
    if robots is not None:
        checks["robots of the plan"] = functools.partial(robots_health, robots, bridges)
    HealthReporter(checks).start()
    rospy.loginfo(f"bridging the operators {', '.join(bridge.operator for bridge in bridges)}")
