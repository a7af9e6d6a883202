# SPDX-License-Identifier: Apache-2.0
"""Navigation: drive to a point of interest or to a pose through move_base."""

import math
from typing import Any, List, Tuple

import rospy
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from merlin_ros.master.master_link import get_param
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.merlin_state import GivenUp

POINTS_PARAM = "world/points_of_interest"


def point_of_interest(name: str) -> PoseStamped:
    """The pose of a point of interest, from the parameters below ``world/points_of_interest``.

    :return: pose in frame map.
    :raises GivenUp: when there is no such point, naming those there are.
    :raises ValueError: when the point has no numbers.
    """
    points = get_param(POINTS_PARAM, {})
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

    It drives as :class:`ActionState` says, also while no velocity guard has named its action.

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


def _goal(target: Any) -> MoveBaseGoal:
    pose = target if isinstance(target, PoseStamped) else point_of_interest(str(target))
    return MoveBaseGoal(target_pose=pose)
