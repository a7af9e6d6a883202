# SPDX-License-Identifier: Apache-2.0
"""The people of a world: where each is, and how they walk."""

import enum
import math
from typing import Callable, Optional, Sequence, Tuple, Union

from merlin_reactive.navigation.path_follower import Path
from merlin_reactive.pose import Point, Pose
from merlin_reactive.recognition.object_classes import SEAT
from merlin_sim.world.world_model import Person, Solid

ROOM = 0.15  # m that a person keeps from a robot

# What is in the way of a step from one point to another; '' when free.
Blocker = Callable[[Point, Point], str]


class WalkState(enum.IntEnum):
    """What a person does; the numbers are those of merlin_msgs/SimPerson."""

    ABSENT = 0
    STANDING = 1
    SITTING = 2
    WALKING = 3


class Patrol:
    """The path of a world file, there and back again, forever."""

    def __init__(self, person: Person, robots: Blocker) -> None:
        self._person = person
        self._robots = robots
        self._path = Path(person.path)
        self._walked = 0.0  # s of walking and pausing; time spent waiting for robots does not count

    def next(self, now: float, elapsed: float) -> Optional[Pose]:
        """Where the next step leads; None while there is no step to take."""
        if now < self._person.delay or self._path.length == 0.0:
            return None
        return self._at(self._walked + elapsed)

    def blocker(self, here: Point, there: Point) -> str:
        """What is in the way of the step: a robot, for a polite person."""
        return self._robots(here, there) if self._person.polite else ""

    def go(self, elapsed: float) -> bool:
        """Takes the step; returns whether it was the last one, which it never is."""
        self._walked += elapsed
        return False

    def _at(self, walked: float) -> Pose:
        way = self._path.length / self._person.speed
        phase = walked % (2 * (way + self._person.pause))
        back = phase > way + self._person.pause
        along = min(phase - (way + self._person.pause) if back else phase, way) * self._person.speed
        along = self._path.length - along if back else along
        x, y = self._path.at(along)
        return Pose(float(x), float(y))


class Walk:
    """A walk along a path to its end.

    :param speed: m/s.
    :param block: says what is in the way.
    """

    def __init__(self, points: Sequence[Point], speed: float, block: Blocker) -> None:
        self._path = Path(points)
        self._speed = speed
        self._along = 0.0  # m
        self.blocker = block

    def next(self, now: float, elapsed: float) -> Optional[Pose]:
        """Where the next step leads."""
        x, y = self._path.at(self._along + self._speed * elapsed)
        return Pose(float(x), float(y))

    def go(self, elapsed: float) -> bool:
        """Takes the step; returns whether it was the last one."""
        self._along += self._speed * elapsed
        return self._along >= self._path.length


class Walker:
    """A person of the world: where, and doing what.

    :param way: what the person does without another request.
    """

    def __init__(self, person: Person, way: Optional[Patrol] = None) -> None:
        self.person = person
        self.pose = Pose(*person.path[0])
        self.state = WalkState.ABSENT if person.absent else WalkState.STANDING
        self.waits_for = ""
        self.walk = 0  # number of the last walk requested at run time
        self._way: Union[Patrol, Walk, None] = None if person.absent else way
        # State and heading at the end of the way.
        self._end: Tuple[WalkState, Optional[float]] = (WalkState.STANDING, None)

    @property
    def solid(self) -> Solid:
        """The body where it is."""
        return self.person.solid(self.pose)

    @property
    def bottom(self) -> float:
        """The height of its lower end, m: a sitting person is shorter, the legs are in the floor."""
        return -SEAT if self.state is WalkState.SITTING else 0.0

    def place(self, pose: Pose, state: WalkState) -> None:
        """Puts the person somewhere; whatever way they were on ends."""
        self.pose, self.state, self.waits_for, self._way = pose, state, "", None

    def start(self, way: Walk, sit: bool, yaw: Optional[float]) -> int:
        """Begins a walk; returns its number."""
        self._end = (WalkState.SITTING if sit else WalkState.STANDING, yaw)
        self._way, self.state, self.waits_for = way, WalkState.WALKING, ""
        self.walk += 1
        return self.walk

    def stop(self) -> int:
        """Ends a walk where the person is; returns the number of the walk that never was."""
        if self.state is WalkState.WALKING:
            self.state = WalkState.STANDING
        self._way, self.waits_for = None, ""
        self.walk += 1
        return self.walk

    def step(self, now: float, elapsed: float) -> bool:
        """Moves the person on; returns whether the person moved, turned, sat down or stood up."""
        step = self._way.next(now, elapsed) if self._way is not None else None
        if self._way is None or step is None:
            return False
        self.waits_for = self._way.blocker(self.pose.point, step.point)
        if self.waits_for:
            return False
        before = (self.pose, self.state)
        moved = step.point != self.pose.point
        yaw = math.atan2(step.y - self.pose.y, step.x - self.pose.x) if moved else self.pose.yaw
        self.pose = Pose(step.x, step.y, yaw)
        self.state = WalkState.WALKING if moved else WalkState.STANDING
        if self._way.go(elapsed):
            self.state, heading = self._end
            self._way = None
            if heading is not None:
                self.pose = Pose(step.x, step.y, heading)
        return before != (self.pose, self.state)
