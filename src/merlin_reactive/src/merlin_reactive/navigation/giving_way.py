# SPDX-License-Identifier: Apache-2.0
"""How a robot gives way: it waits before the other's way, or goes aside until that is free."""

import math
from dataclasses import dataclass
from typing import List, Optional

import numpy as np

from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_reactive.navigation.refuge import nearest_refuge
from merlin_reactive.navigation.right_of_way import RightOfWay
from merlin_reactive.pose import Point, Pose

SEARCH_EVERY = 0.5  # s
THERE = 0.1  # m from the place aside at which it has arrived


@dataclass(frozen=True)
class Given:
    """What a robot has to do for the others now.

    :param room: m that it may drive on along its way.
    :param replan: its target has changed: plan a new way before anything else.
    :param waited: s since it began to give way.
    :param robot: the one that it gives way to; empty: none.
    """

    room: float = math.inf
    replan: bool = False
    waited: float = 0.0
    robot: str = ""

    @property
    def reason(self) -> str:
        """Why it stands: a verb and the rest of a sentence."""
        if self.robot:
            return f"gives way to robot {self.robot}"
        return "finds no way past the other robots"


class GivingWay:
    """The state of giving way during one drive. Used by the thread that drives.

    :ivar refuge: where it goes instead of its goal.
    """

    def __init__(self, rules: RightOfWay, planner: PathPlanner) -> None:
        self.rules = rules
        self._planner = planner
        self.start()

    def start(self) -> None:
        """Begins with a new drive."""
        self.refuge: Optional[Point] = None
        self.rules.cornered = self.rules.astray = False
        self._since: Optional[float] = None
        self._robot = ""
        self._searched_at = -math.inf

    def step(self, pose: Pose, way: np.ndarray, seen: np.ndarray, now: float) -> Given:
        """What to do at a pose, on a way (points, STEP apart), at a time, s.

        :param seen: points that are in the way besides the map and the robots.
        """
        here = pose.point
        if self.refuge is not None:
            if self.rules.clear(here, now) or math.dist(here, self.refuge) < THERE:
                self.refuge = None
                return self._given(now, room=0.0, replan=True)
            if self.rules.clear(self.refuge, now) or not self._search(here, seen, now):
                return self._given(now)
            return self._given(now, replan=True)
        meeting = self.rules.look(here, way, now)
        if not meeting.robot:
            self._since = None
            return Given()
        if self._since is None:
            self._since = now
        self._robot = meeting.robot
        moved = meeting.aside and self._search(here, seen, now)
        return self._given(now, room=meeting.room, replan=moved)

    def unreachable(self) -> None:
        """Notes that no path leads to the place aside: the others have to give way."""
        self.refuge = None
        self.rules.cornered = True

    def bodies(self, now: float) -> List[np.ndarray]:
        """Outlines (n x 2) that a way leads around: of all robots; if that cannot be, of those before it."""
        first = frozenset(other.name for other in self.rules.first(now))
        return [self.rules.bodies(now), self.rules.bodies(now, first)]

    def _given(self, now: float, room: float = math.inf, replan: bool = False) -> Given:
        return Given(room, replan, now - (now if self._since is None else self._since), self._robot)

    def _search(self, here: Point, seen: np.ndarray, now: float) -> bool:
        if now - self._searched_at < SEARCH_EVERY:
            return False
        self._searched_at = now
        rules = self.rules
        first, others = rules.first(now), rules.others(now)
        self.refuge = nearest_refuge(self._planner, here, first, others, seen)
        if self.refuge is None and len(first) < len(others):
            # Those that go after it see its way, and make room as it does.
            self.refuge = nearest_refuge(self._planner, here, first, first, seen)
        rules.cornered = self.refuge is None
        return self.refuge is not None
