"""Node: the bridges (:class:`MerlinAction`) of all actions in one process."""

import math
from typing import Any, Dict, List

import rospy

from merlin_actions.action_interface import wait_for_knowledge_base
from merlin_actions.core.names import by_ros_name
from merlin_actions.merlin_action import MerlinAction
from merlin_ros.health import HealthReporter
from merlin_ros.node import on_master_lost, run_node
from merlin_ros.parameters import number
from merlin_sm.knowledge_client import (
    DEFAULT_KNOWLEDGE_BASE,
    KnowledgeBaseMissing,
    KnowledgeError,
    knowledge_client,
)


def make_bridges(operators: List[str], knowledge_base: str) -> List[MerlinAction]:
    """Makes a bridge for each operator, with the limits of this node's parameters.

    :param operators: names; none: every operator of the domain.
    :raises ValueError: when two of them map to one ROS name.
    :raises KnowledgeError: when the domain lacks one.
    :raises ParameterError: when a limit is not a number.
    """
    names = operators or list(knowledge_client(knowledge_base).operators())
    by_ros_name(names)
    options: Dict[str, Any] = {
        key: str(rospy.get_param(f"~{key}"))
        for key in ("dispatch_topic", "feedback_topic")
        if rospy.has_param(f"~{key}")
    }
    for key in ("server_wait", "cancel_limit", "run_limit"):
        if rospy.has_param(f"~{key}"):
            options[key] = number(f"~{key}", 0.0, -math.inf)
    return [MerlinAction(name, knowledge_base=knowledge_base, **options) for name in names]


def main() -> int:
    """Runs the node; returns the exit code."""
    missing = (KnowledgeBaseMissing, rospy.ServiceException)
    return run_node("merlin_bridges", _start, KnowledgeError, ValueError, missing=missing)


def _start() -> None:
    knowledge_base = rospy.get_param("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
    wait_for_knowledge_base(knowledge_base, number("~knowledge_base_wait", 30.0, 0.0))
    bridges = make_bridges(rospy.get_param("~operators", []), knowledge_base)
    for bridge in bridges:
        bridge.start()
        rospy.on_shutdown(bridge.shutdown)
        on_master_lost(bridge.master_lost)
    HealthReporter({bridge.operator: bridge.health for bridge in bridges}).start()
    rospy.loginfo(f"bridging the operators {', '.join(bridge.operator for bridge in bridges)}")
