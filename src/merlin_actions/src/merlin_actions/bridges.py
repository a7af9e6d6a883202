"""Node: the bridges (:class:`MerlinAction`) of all actions in one process."""

import sys
from typing import List

import rospy

from merlin_actions.action_interface import wait_for_knowledge_base
from merlin_actions.merlin_action import MerlinAction
from merlin_actions.names import by_ros_name
from merlin_sm.health import HealthReporter
from merlin_sm.knowledge_client import DEFAULT_KNOWLEDGE_BASE, KnowledgeError, knowledge_client


def make_bridges(operators: List[str], knowledge_base: str) -> List[MerlinAction]:
    """Makes a bridge for each operator, with the limits of this node's parameters.

    :param operators: names; none: every operator of the domain.
    :raises ValueError: when two of them map to one ROS name.
    :raises KnowledgeError: when the domain lacks one.
    """
    names = operators or list(knowledge_client(knowledge_base).operators())
    by_ros_name(names)
    options = {
        key: rospy.get_param(f"~{key}")
        for key in ("dispatch_topic", "feedback_topic", "server_wait", "cancel_limit", "run_limit")
        if rospy.has_param(f"~{key}")
    }
    return [MerlinAction(name, knowledge_base=knowledge_base, **options) for name in names]


def main() -> None:
    """Runs the node."""
    rospy.init_node("merlin_bridges")
    knowledge_base = rospy.get_param("~knowledge_base", DEFAULT_KNOWLEDGE_BASE)
    try:
        wait_for_knowledge_base(knowledge_base, rospy.get_param("~knowledge_base_wait", 30.0))
        bridges = make_bridges(rospy.get_param("~operators", []), knowledge_base)
    except (KnowledgeError, ValueError, rospy.ServiceException) as error:
        rospy.logfatal(f"merlin_bridges: {error}")
        sys.exit(1)
    for bridge in bridges:
        bridge.start()
    HealthReporter({bridge.operator: bridge.health for bridge in bridges}).start()
    rospy.loginfo(f"bridging the operators {', '.join(bridge.operator for bridge in bridges)}")
    rospy.spin()
    for bridge in bridges:
        bridge.shutdown()
