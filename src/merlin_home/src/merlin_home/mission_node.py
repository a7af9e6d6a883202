"""Node `mission`: runs one of the paper's missions.

Exit code: 0 when every task ended as the list says, 1 when one did not, 2 when the mission could not begin.
"""

import sys
from typing import List

import rospy

from merlin_executor.readiness import missing_interfaces, missing_servers
from merlin_home.home_mission import HomeMission
from merlin_home.mission_list import MissionListError, MissionTask, make_mission, mission_tasks
from merlin_ros.node import init_node
from merlin_ros.parameters import ParameterError, number
from merlin_sm.knowledge_client import KnowledgeError

EXIT_FAILED, EXIT_NOT_BEGUN = 1, 2
#: Action servers that the actions of the home use.
SERVERS = ("move_base", "sound_play")


class NotReady(RuntimeError):
    """A part of the robot is missing; the text says which."""


def main() -> int:
    """Entry point of the node; returns the exit code."""
    init_node("mission")
    try:
        mission = HomeMission(read_tasks(), number("~cancel_after", 10.0, 0.1))
        wait_for_robot(mission, number("~startup_timeout", 60.0, 1.0))
    except (ParameterError, MissionListError, NotReady) as error:
        print(f"mission: {error}", file=sys.stderr)
        return EXIT_NOT_BEGUN
    try:
        return 0 if mission.execute() else EXIT_FAILED
    except KnowledgeError as error:  # a point that the problem does not know, for example
        print(f"mission: {error}", file=sys.stderr)
    return EXIT_FAILED


def read_tasks() -> List[MissionTask]:
    """The task list that the parameters describe.

    :raises ParameterError: when a parameter is not a number.
    :raises MissionListError: when no list can be made of them.
    """
    points = str(rospy.get_param("~points", "")).split() or list(
        rospy.get_param("world/points_of_interest", {})
    )
    count = int(number("~tasks", 0, 0)) or mission_tasks(int(number("~mission", 1, 1)))
    return make_mission(points, count, int(number("~seed", 1, 0)), number("~marked_share", 0.5, 0.0))


def wait_for_robot(mission: HomeMission, timeout: float) -> None:
    """Waits for the knowledge base, the action interfaces and the servers that the actions use.

    :param timeout: of each, s of running time.
    :raises NotReady: when one is not there.
    """
    if not mission.knowledge.wait(timeout):
        raise NotReady(f"no knowledge base {mission.knowledge.name} after {timeout:.0f} s")
    for operator in missing_interfaces(mission.knowledge, timeout):
        raise NotReady(f"no action interface for {operator} after {timeout:.0f} s")
    for server in missing_servers(SERVERS, timeout):
        raise NotReady(f"no action server {server} after {timeout:.0f} s; is it launched?")
