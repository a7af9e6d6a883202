# SPDX-License-Identifier: Apache-2.0
"""Node: publishes on latched topics what a recording needs besides: the first knowledge, and parameters.

It begins together with ``rosbag record``; see ``record.launch``.
"""

from pathlib import Path
from typing import Any, Callable, Dict, Optional

import rospy
import yaml
from merlin_msgs.msg import KnowledgeChanges
from std_msgs.msg import String

from merlin_monitor.bag import KNOWLEDGE, PARAMETERS
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import OFFERED
from merlin_monitor.panels.control import SENTENCES, path_of_node
from merlin_monitor.text.sentences import read_sentences
from merlin_planning.knowledge_client import KnowledgeClient, instance
from merlin_ros.node import run_node, spin
from merlin_ros.robot_values import ROBOTS
from merlin_ros.service_proxy import ServiceError

#: Parameters that the page and rviz read, below the robot's namespace.
READ = ("world", "robot_description", ROBOTS, OFFERED, "rosplan_planner_interface")
#: Parameters of the monitor that say what it shows; its address and its operators are its own.
MONITOR = ("panels", "map_topic", "people_topic", "global_frame", "base_frame")
#: Named as the client that made what was known when the recording began.
BEGIN = "the begin of the recording"


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("recorded_state", _start)


def _start() -> Any:
    parameters = rospy.Publisher(PARAMETERS, String, queue_size=1, latch=True)
    parameters.publish(String(yaml.safe_dump(recorded_parameters())))
    publisher = rospy.Publisher(KNOWLEDGE, KnowledgeChanges, queue_size=1, latch=True)
    client = KnowledgeClient(str(rospy.get_param("~knowledge_base", "rosplan_knowledge_base")))

    def publish() -> None:
        if client.wait():
            try:
                publisher.publish(everything(client))
            except ServiceError as error:
                rospy.logwarn(f"the recording begins without the knowledge: {error}")
        spin()

    return publish


def everything(client: KnowledgeClient) -> KnowledgeChanges:
    """All that a knowledge base knows, as one change.

    Its stamp is from before the reading: later changes may be in it, and change nothing when applied again.
    """
    change = KnowledgeChanges(client=BEGIN, cleared=True)
    change.header.stamp = rospy.Time.now()
    change.added += [instance(kind, name) for name, kind in client.objects().items()]
    change.added += [*client.propositions(), *client.functions()]
    change.goals_added += client.goals()
    return change


def recorded_parameters() -> Dict[str, Any]:
    """Parameters by their global names; domain and sentences as a file with its text."""
    wanted = [*READ, *(f"merlin_monitor/{name}" for name in MONITOR)]
    found = {rospy.resolve_name(name): rospy.get_param(name, None) for name in wanted}
    domain = f"{rospy.get_param('~knowledge_base', 'rosplan_knowledge_base')}/domain_path"
    found[rospy.resolve_name(SENTENCES)] = _text_of(SENTENCES, read_sentences)
    found[rospy.resolve_name(domain)] = _text_of(domain)
    return {name: value for name, value in found.items() if value is not None}


def _text_of(
    parameter: str, check: Callable[[Path, str], object] = lambda file, text: None
) -> Optional[Dict[str, str]]:
    """File and text of what a parameter names, since the file may change; None: there is none."""
    file = path_of_node(RosSystem(), parameter)
    if file is None:
        return None
    try:
        text = file.read_text(encoding="utf-8")
        check(file, text)
    except (OSError, ValueError) as error:
        rospy.logwarn(f"the recording has no {parameter}: {error}")
        return None
    return {"file": str(file), "text": text}
