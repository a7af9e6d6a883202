# SPDX-License-Identifier: Apache-2.0
"""Where the robots of one plan were last, also those that are gone."""

import math
import threading
import time
from typing import Any, Dict, List, Tuple

import rospy
from merlin_msgs.msg import RobotWay

from merlin_planning.robot_roster import RobotRoster
from merlin_ros.actions.peers import sender_of
from merlin_ros.master.master_link import get_param
from merlin_sm.states.navigation import POINTS_PARAM

STANDS_AT = 0.6  # m from a point of interest within which a robot keeps others from standing there


class RobotPlaces:
    """Follows what robots say of their drives on ``/robot_ways``; safe to use from several threads.

    When a robot dies as it sets off, the knowledge has it ``anywhere``, and it still stands at its start.
    """

    def __init__(self) -> None:
        self._roster = RobotRoster()
        self._lock = threading.Lock()  # guards the field below
        self._places: Dict[str, Tuple[float, float]] = {}  # m, frame map
        self._subscriber = rospy.Subscriber("/robot_ways", RobotWay, self._take, queue_size=10)

    def points_at(self, robot: str) -> List[str]:
        """The points of interest at which a robot stands, the nearest first.

        The points are the robot's own, ``/<robot>/world/points_of_interest``. None when it has never driven.
        """
        place = self.places().get(robot)
        points: Dict[str, Any] = get_param(f"/{robot}/{POINTS_PARAM}", {}) if place is not None else {}
        far = {
            name: math.dist(place, (float(point["x"]), float(point["y"])))
            for name, point in points.items()
            if place is not None
        }
        return sorted((name for name in far if far[name] < STANDS_AT), key=lambda name: far[name])

    def places(self) -> Dict[str, Tuple[float, float]]:
        """Where each robot that has driven was last, m in frame map."""
        with self._lock:
            return dict(self._places)

    def _take(self, way: RobotWay) -> None:
        position = way.pose.position
        admission = self._roster.admit(way.robot, sender_of(way), time.monotonic())
        if admission.refusal:
            rospy.logwarn(admission.refusal)
        with self._lock:
            self._places.pop(admission.forgotten, None)
            if not admission.counts:
                return
            self._places[way.robot] = (position.x, position.y)
