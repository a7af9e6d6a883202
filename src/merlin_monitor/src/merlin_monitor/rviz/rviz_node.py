# SPDX-License-Identifier: Apache-2.0
"""Node: what rviz shows of MERLIN, and goals for points of interest that are clicked there."""

from typing import Dict, List

import rospy

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panels.control import sentences_of_node
from merlin_monitor.panels.map import MapPanel
from merlin_monitor.panels.now import NowPanel
from merlin_monitor.panels.plan import PlanPanel
from merlin_monitor.rviz.clicked_goals import BLANK, ClickedGoals
from merlin_monitor.rviz.markers import MarkerPublisher
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, number, whole

REACH = 2.0  # m
LEAST_REACH = 0.01  # m


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("rviz_markers", _start)


def _start() -> None:
    frame = str(rospy.get_param("~global_frame", "map"))
    goal, priority = _goal(), whole("~priority", 0)
    reach = number("~reach", REACH, LEAST_REACH)
    state = MonitorModel(Inbox(rospy.logwarn))
    state.wording.sentences = sentences_of_node(RosSystem(), needed=False)
    panels: List[Panel] = []

    def look(topics: Dict[str, str]) -> None:
        for panel in panels:
            panel.look(topics)

    watch = GraphWatch(look)
    panels += [MapPanel(state, watch), NowPanel(state, watch), PlanPanel(state, watch)]
    publisher = MarkerPublisher(state, frame)
    # Only the inbox of the model: nothing is drawn for a page, and no history is kept.
    state.inbox.start()
    watch.start()
    rospy.on_shutdown(publisher.stop)
    rospy.on_shutdown(state.inbox.stop)
    ClickedGoals(frame, goal, priority, reach)


def _goal() -> str:
    goal = str(rospy.get_param("~goal", f"(robot_at {BLANK})"))
    try:
        if BLANK not in goal:
            raise PDDLSyntaxError(f"it does not have {BLANK}")
        parse_goal(goal.replace(BLANK, "point"))
    except PDDLSyntaxError as error:
        name = rospy.resolve_name("~goal")
        raise ParameterError(f"parameter {name} is {goal!r}: {error}; give (robot_at {BLANK})") from error
    return goal
