# SPDX-License-Identifier: Apache-2.0
"""Node `mission`: runs the mission that is named ``package.module:Class``.

Exit code: 0 when the mission succeeded, 1 when it failed, 2 when it could not begin, continue or keep its
results, 130 when it was interrupted.
"""

import inspect
import sys
from typing import Type

import rospy
from rosgraph.names import load_mappings

from merlin_executor.announced import robots_of_plan
from merlin_executor.core.robot_lines import Screen
from merlin_executor.mission.mission_node import MissionNode, run_mission
from merlin_executor.mission.robot_log import RobotLog
from merlin_ros.class_path import load_class
from merlin_ros.node import CANNOT_BEGIN, init_node


def main(path: str = "") -> int:
    """Runs the node; returns the exit code.

    :param path: ``package.module:Class``; empty: from the command line, ``mission:=…``, or else from the
        parameter ``~mission``.
    """
    init_node("mission")
    try:
        mission_class = load_mission(path or named_mission())
    except ValueError as error:
        print(f"mission: {error}", file=sys.stderr)
        return CANNOT_BEGIN
    screen = Screen(rospy.get_time)
    if rospy.get_param("~tell", mission_class.tells):
        RobotLog(lambda text: screen.line("robot", text), robots=robots_of_plan() or ("",))
    return run_mission(mission_class)


def named_mission() -> str:
    """The path that the command line or the parameter gives.

    :raises ValueError: when neither does.
    """
    path = load_mappings(sys.argv).get("mission") or rospy.get_param("~mission", "")
    if not path:
        raise ValueError("no mission is named; give mission:=package.module:Class or the parameter ~mission")
    return str(path)


def load_mission(path: str) -> Type[MissionNode]:
    """The class of a mission.

    :param path: ``package.module:Class``.
    :raises ValueError: when the class does not exist or is not a complete mission.
    """
    found = load_class(path)
    if not issubclass(found, MissionNode):
        raise ValueError(f"{path!r} is not a mission; derive it from GoalDispatcher or MissionSM")
    if inspect.isabstract(found):
        missing = ", ".join(f"{name}()" for name in sorted(getattr(found, "__abstractmethods__", ())))
        raise ValueError(f"{path!r} is not a complete mission; it has to implement {missing}")
    return found
