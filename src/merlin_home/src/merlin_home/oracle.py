"""The best that a robot could do: the yardstick of the experiment.

For one task, from the pose in which it was sent: turn to the direction of the shortest path while setting
off, drive along it as fast as the limits allow, stop at the point of interest, and speak. Deliberation,
communication, detours and caution take no time here; no run can reach this, and the ratio of oracle to
measurement says how close one came.
"""

import math
from dataclasses import dataclass
from typing import List

from .motion_limits import MotionLimits
from .shortest_path import Point, ShortestPaths, angle_between, path_length


@dataclass(frozen=True)
class OracleResult:
    """What the best possible execution of a task takes.

    Attributes:
        time: s, from sending to the end.
        distance: m.
    """

    time: float
    distance: float


class Oracle:
    """Best possible executions on one map."""

    def __init__(
        self, paths: ShortestPaths, limits: MotionLimits, speech: float, goal_tolerance: float = 0.0
    ) -> None:
        """
        Parameters:
            paths: shortest paths on the map.
            limits: of the robot.
            speech: true length of the spoken question, s.
            goal_tolerance: distance from a point at which a drive to it may end, m.
        """
        self._paths = paths
        self._limits = limits
        self._speech = speech
        self._tolerance = goal_tolerance

    def task(self, start: Point, heading: float, goal: Point, cancel_after: float = math.inf) -> OracleResult:
        """The best execution of one task.

        Parameters:
            start: where the robot is when the task is sent, frame map, m.
            heading: its heading there, rad.
            goal: the point of interest, frame map, m.
            cancel_after: when the task is cancelled, s after sending; infinite: never.

        Raises:
            NoPathError: the map has no way there.
        """
        return self.along(self._paths.path(start, goal), heading, cancel_after)

    def along(self, vertices: List[Point], heading: float, cancel_after: float = math.inf) -> OracleResult:
        """As `task`, along a given polyline that starts at the robot (m)."""
        length = max(0.0, path_length(vertices) - self._tolerance)
        if length == 0.0:
            return OracleResult(min(self._speech, cancel_after), 0.0)
        first = next(b for b in vertices[1:] if b != vertices[0])
        direction = math.atan2(first[1] - vertices[0][1], first[0] - vertices[0][0])
        drive = self._limits.set_off(angle_between(heading, direction), length)
        whole = drive.duration + self._speech
        if whole <= cancel_after:
            return OracleResult(whole, length)
        return OracleResult(cancel_after, drive.way_at(cancel_after))
