"""What the map shows of a robot beside its place: the way it means to take, its goal and where it was."""

import math
from collections import deque
from typing import Any, Deque, Optional, Protocol, Sequence, Tuple

LONGEST_PATH = 300  # points that are shown
TRAIL_STEP = 0.15  # m between two points of the trail
LONGEST_TRAIL = 400  # points
JUMP = 2.0  # m; further away within one look, the robot was put there


class TrackStore(Protocol):
    """Where it is kept: a path of names, and last a value."""

    def set(self, *path_and_value: Any) -> bool:
        """Stores a value under a path; returns whether it differs."""

    def remove(self, *path: str) -> bool:
        """Removes the value under a path; returns whether there was one."""


class RobotTrack:
    """Keeps ``path``, ``goal`` and ``trail`` of one robot.

    :param tree: of the state.
    :param place: where these three are in the state.
    """

    def __init__(self, tree: TrackStore, *place: str) -> None:
        self._tree = tree
        self._place = place
        self._trail: Deque[Tuple[int, float, float]] = deque()

    def path(self, points: Sequence[Tuple[float, float]]) -> None:
        """The way the robot means to take, m; none: it is not going anywhere."""
        stride = max(1, -(-len(points) // LONGEST_PATH))
        shown = [[round(x, 2), round(y, 2)] for x, y in points[::stride]]
        if points and stride > 1:
            shown.append([round(points[-1][0], 2), round(points[-1][1], 2)])
        self._tree.set(*self._place, "path", shown)

    def goal(self, pose: Optional[Tuple[float, float, float]]) -> None:
        """Where it is going, m and rad; None: nowhere."""
        shown = None if pose is None else [round(value, 3) for value in pose]
        self._tree.set(*self._place, "goal", shown)

    def was(self, x: float, y: float) -> None:
        """Notes where the robot is, m."""
        trail = self._trail
        number = 0
        if trail:
            number, last_x, last_y = trail[-1]
            far = math.hypot(x - last_x, y - last_y)
            if far < TRAIL_STEP:
                return
            if far > JUMP:
                trail.clear()
                self._tree.set(*self._place, "trail", {})
        trail.append((number + 1, x, y))
        self._tree.set(*self._place, "trail", str(number + 1), [round(x, 2), round(y, 2)])
        if len(trail) > LONGEST_TRAIL:
            self._tree.remove(*self._place, "trail", str(trail.popleft()[0]))
