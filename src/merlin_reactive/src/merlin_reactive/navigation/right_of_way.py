# SPDX-License-Identifier: Apache-2.0
"""Which of several robots goes first where their ways meet. Knows no ROS.

The rule: a robot whose name comes first in the alphabet goes first. The others wait before its way, or go
aside when they stand on it (`refuge`). One that finds no such place says so and goes before those that do.
"""

import dataclasses
import math
import threading
from dataclasses import dataclass
from typing import Dict, FrozenSet, List, Optional, Tuple

import numpy as np

from merlin_reactive.pose import Point, Pose

STEP = 0.1  # m between the points of a way
ANNOUNCED = 60  # points of a way that is published to other robots
HORIZON = 40  # points of both ways that are compared: farther ahead everything may change yet
PASSING = 0.10  # m between two robots that pass each other
WAITING = 0.17  # m that a robot which gives way keeps from the other's way
ASIDE = 0.22  # m beside it of a place to go aside to
RESERVE = 0.6  # m by which the other may be faster, or this one slower, than it seems
COMING = 0.03  # m that its way leads nearer to be coming
SILENT = 1.5  # s after which a robot that said nothing is an obstacle like any other
OUTLINE = np.stack([f(np.linspace(0.0, 2 * np.pi, 16, endpoint=False)) for f in (np.cos, np.sin)], axis=1)


@dataclass(frozen=True)
class RobotWay:
    """What a driving robot publishes to the others.

    :param way: points (n x 2, m, frame map), STEP apart, from where it is; at most ANNOUNCED.
    :param cornered: it has found no place to go aside to.
    :param aside: it goes to a place aside, and waits for no other robot on its way there.
    :param driving: False: it has stopped to drive, and is an obstacle like any other.
    """

    name: str
    pose: Pose
    radius: float
    way: np.ndarray
    cornered: bool = False
    aside: bool = False
    driving: bool = True

    @property
    def rank(self) -> Tuple[bool, bool, str]:
        """The right of way: the smaller one goes first. The way of a robot that finds none is one point."""
        return not self.cornered, len(self.way) < 2, self.name


@dataclass(frozen=True)
class Meeting:
    """What the others' right of way leaves of a robot's own way.

    :param room: m that it may drive on.
    :param robot: which one it waits for; empty: none.
    :param aside: it stands where the other wants to go.
    """

    room: float = np.inf
    robot: str = ""
    aside: bool = False


class RightOfWay:
    """What one robot knows of the others' ways, and which robot goes first.

    The lock guards the ways of others; `note` is for any thread, the rest for the thread that drives.

    :param name: of this robot.
    :param radius: of this robot, m.
    """

    def __init__(self, name: str, radius: float) -> None:
        self.name, self.radius = name, radius
        self.cornered = self.astray = False
        self._lock = threading.Lock()
        self._ways: Dict[str, Tuple[RobotWay, float]] = {}

    def note(self, other: RobotWay, now: float) -> None:
        """Takes what another robot says of itself at a time, s."""
        if other.name == self.name:
            return
        with self._lock:
            for name in [name for name, (_, noted) in self._ways.items() if abs(now - noted) >= SILENT]:
                del self._ways[name]
            if other.driving:
                self._ways[other.name] = other, now
            else:
                self._ways.pop(other.name, None)

    def others(self, now: float) -> List[RobotWay]:
        """The other robots that drive."""
        with self._lock:
            return [other for other, noted in self._ways.values() if abs(now - noted) < SILENT]

    def first(self, now: float) -> List[RobotWay]:
        """The robots that go first, in their order; of each the way up to its first wait."""
        own = (not self.cornered, self.astray, self.name)
        before = [other for other in self.others(now) if other.rank < own]
        found: List[RobotWay] = []
        for other in sorted(before, key=lambda robot: robot.rank):
            waits = [] if other.aside else [_entry(other.way, other.radius, earlier) for earlier in found]
            free = min((entry for entry in waits if entry is not None), default=math.inf)
            points = 1 + int(min(free / STEP, len(other.way)))
            found.append(dataclasses.replace(other, way=other.way[:points]))
        return found

    def bodies(self, now: float, names: Optional[FrozenSet[str]] = None) -> np.ndarray:
        """Points (n x 2) on the outlines of the other robots, or of those that are named."""
        outlines = [
            np.array(other.pose.point) + other.radius * OUTLINE
            for other in self.others(now)
            if names is None or other.name in names
        ]
        return np.concatenate([np.zeros((0, 2)), *outlines])

    def clear(self, here: Point, now: float) -> bool:
        """Whether a place is off the ways of all that go first."""
        return all(_gaps(here, other).min() >= self._keep(other, WAITING) for other in self.first(now))

    def look(self, here: Point, way: np.ndarray, now: float) -> Meeting:
        """Where this robot has to wait on its way (points, STEP apart), and whether it has to go aside."""
        self.cornered = self.cornered and any(
            _entry(way, self.radius, other) is not None for other in self.others(now)
        )
        found = Meeting()
        for other in self.first(now):
            entry = _entry(way, self.radius, other)
            if entry is None:
                continue
            aside = found.aside or (entry == 0.0 and self._stands_in_the_way(here, other))
            nearer = entry < found.room
            found = Meeting(min(entry, found.room), other.name if nearer else found.robot, aside)
        return found

    def _keep(self, other: RobotWay, gap: float) -> float:
        return self.radius + other.radius + gap

    def _stands_in_the_way(self, here: Point, other: RobotWay) -> bool:
        nearest = float(_gaps(here, other).min())
        return nearest < self._keep(other, PASSING) and nearest < other.pose.distance(Pose(*here)) - COMING


def _entry(way: np.ndarray, radius: float, other: RobotWay) -> Optional[float]:
    """How far a robot may go before the other's way begins, m; None: it is through before the other comes."""
    mine, theirs = way[:HORIZON], other.way[:HORIZON]
    gaps = np.hypot(mine[:, :1] - theirs[:, 0], mine[:, 1:] - theirs[:, 1])
    near = gaps < radius + other.radius + WAITING
    s, u = np.arange(len(mine))[:, None] * STEP, np.arange(len(theirs)) * STEP
    too_late = (near & (u <= s + RESERVE)).any(axis=1)
    if not too_late.any():
        return None
    off = np.nonzero(~near.any(axis=1)[: int(np.argmax(too_late))])[0]
    return float(off[-1] + 1) * STEP if len(off) else 0.0


def _gaps(here: Point, other: RobotWay) -> np.ndarray:
    return np.hypot(other.way[:, 0] - here[0], other.way[:, 1] - here[1])
