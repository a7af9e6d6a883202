# SPDX-License-Identifier: Apache-2.0
"""The best that a robot could do: the yardstick of the experiment.

For one task, from the pose and motion in which it was sent: turn to the direction of the shortest path while
setting off, drive along it as fast as the limits allow, stop at the point of interest, and speak. The path is
the shortest that a disc of the robot's radius can take without touching what stands there. Deliberation,
communication, detours and caution take no time here; no run can be faster, and the ratio of oracle to
measurement says how close one came.
"""

import math
from dataclasses import dataclass
from typing import Tuple

from merlin_experiment.oracle.motion_limits import MotionLimits
from merlin_experiment.oracle.outlines import Point
from merlin_experiment.oracle.shortest_path import ShortestPaths, angle_between


@dataclass(frozen=True)
class OracleResult:
    """What the best possible execution of a task takes.

    :ivar time: s, from sending to the end.
    :ivar distance: m.
    """

    time: float
    distance: float


class Oracle:
    """Best possible executions in one place."""

    def __init__(
        self, paths: ShortestPaths, limits: MotionLimits, speech: float, goal_tolerance: float = 0.0
    ) -> None:
        """:param paths: shortest paths of the robot's disc.
        :param limits: of the robot.
        :param speech: true length of the spoken question, s.
        :param goal_tolerance: distance from a point at which a drive to it may end, m.
        """
        self._paths = paths
        self._limits = limits
        self._speech = speech
        self._tolerance = goal_tolerance

    def task(
        self,
        start: Point,
        heading: float,
        goal: Point,
        cancel_after: float = math.inf,
        motion: Tuple[float, float] = (0.0, 0.0),
    ) -> OracleResult:
        """The best execution of one task.

        :param start: where the robot is when the task is sent, frame map, m.
        :param heading: its heading there, rad.
        :param goal: the point of interest, frame map, m.
        :param cancel_after: when the task is cancelled, s after sending; infinite: never.
        :param motion: speed (m/s) and turning speed (rad/s) that it still has there; a robot sent on while it
            brakes does not begin from rest.
        :raises NoPathError: when no path exists.
        """
        route = self._paths.path(start, goal)
        length = max(0.0, route.length - self._tolerance)
        if length == 0.0:
            return OracleResult(min(self._speech, cancel_after), 0.0)
        turn = angle_between(heading, route.direction)
        # Turning away never helps.
        turning = max(0.0, motion[1] * math.copysign(1.0, turn))
        drive = self._limits.set_off(turn, length, (max(0.0, motion[0]), turning))
        whole = drive.duration + self._speech
        if whole <= cancel_after:
            return OracleResult(whole, length)
        return OracleResult(cancel_after, drive.way_at(cancel_after))
