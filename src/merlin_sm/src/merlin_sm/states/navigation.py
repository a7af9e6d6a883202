# SPDX-License-Identifier: Apache-2.0
"""Navigation: drive to a point of interest or to a pose through move_base."""

import math
from typing import Any, Callable, List, Tuple

import rospy
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_srvs.srv import Empty

from merlin_ros.master.master_link import MasterSilent, get_param
from merlin_ros.service_proxy import ServiceProxy
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, GivenUp
from merlin_sm.states.ros_calls import call_apart

POINTS_PARAM = "world/points_of_interest"
CLEAR_PARAM = "merlin/clear_costmaps"
CLEAR_LIMIT = 1.0  # s of running time by which a service that hangs delays a drive


def point_of_interest(name: str) -> PoseStamped:
    """The pose of a point of interest, from the parameters below ``world/points_of_interest``.

    :return: pose in frame map.
    :raises GivenUp: when there is no such point, naming those there are.
    :raises ValueError: when the point has no numbers, or the points cannot be read.
    """
    try:
        points = get_param(POINTS_PARAM, {})
    except MasterSilent as error:
        raise ValueError(str(error)) from None
    if not isinstance(points, dict):
        raise ValueError(point_faults(points)[0])
    if name not in points:
        known = ", ".join(sorted(points)) or "none"
        where = rospy.resolve_name(POINTS_PARAM)
        raise GivenUp(f"unknown point of interest {name!r}; {where} has: {known}", about=name)
    x, y, yaw = _numbers(name, points[name])
    pose = PoseStamped()
    pose.header.frame_id = "map"
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return pose


def point_faults(points: Any) -> List[str]:
    """What is wrong with the value of ``world/points_of_interest``, a sentence for each point."""
    if not isinstance(points, dict):
        return [f"{POINTS_PARAM} is {points!r}; write name: {{x: …, y: …, yaw: …}} for each point"]
    found = []
    for name, point in points.items():
        try:
            _numbers(name, point)
        except ValueError as error:
            found.append(f"{error}; correct points_of_interest")
    return found


def _numbers(name: str, point: Any) -> Tuple[float, float, float]:
    try:
        x, y, yaw = (float(point[key]) for key in ("x", "y", "yaw"))
        if not all(map(math.isfinite, (x, y, yaw))):
            raise ValueError(name)
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"point of interest {name!r} needs numbers x, y (m) and yaw (rad)") from None
    return x, y, yaw


class NavigationState(ActionState):
    """Drives to ``userdata.target``: the name of a point of interest, or a PoseStamped.

    It drives as :class:`ActionState` says, also while no velocity guard has named its action. When its last
    drive failed, it calls ``clear_costmaps`` of the action first, where there is one (std_srvs/Empty; 1 s at
    most), unless the parameter ``merlin/clear_costmaps`` is false.

    :param target: drives there instead; userdata is not read then.
    :param action: name of the move_base action.
    """

    drives = True

    def __init__(self, target: Any = None, action: str = "move_base", **options: Any) -> None:
        keys = [] if target is not None else ["target"]
        super().__init__(
            action,
            MoveBaseAction,
            (lambda _: _goal(target)) if target is not None else (lambda userdata: _goal(userdata.target)),
            input_keys=keys,
            **options,
        )
        self.target = target
        self._costmaps = ServiceProxy(f"{self._client.name}/clear_costmaps", Empty)

    def run(self, userdata: Any) -> str:
        """Clears the costmaps after a drive that failed, then drives."""
        if self.outcome == ABORTED:
            ends = call_apart(self, self._costmaps.name, self._clear, CLEAR_LIMIT)
            if not self.preempt_requested() and ends != [None]:
                why = ends[0] if ends else f"{self._costmaps.name} did not answer within {CLEAR_LIMIT:g} s"
                rospy.logwarn(f"{why}; the drive begins with the costmaps as they are")
        return PREEMPTED if self.preempt_requested() else super().run(userdata)

    def _clear(self, ended: Callable[[], bool]) -> None:
        if get_param(CLEAR_PARAM, True) and self._costmaps.wait(0.0) and not ended():
            self._costmaps()
            rospy.loginfo(f"called {self._costmaps.name}, because the last drive failed")


def _goal(target: Any) -> MoveBaseGoal:
    pose = target if isinstance(target, PoseStamped) else point_of_interest(str(target))
    return MoveBaseGoal(target_pose=pose)
