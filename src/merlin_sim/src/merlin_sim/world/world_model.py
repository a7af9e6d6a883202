# SPDX-License-Identifier: Apache-2.0
"""The model of a simulated world: what stands where, on paper.

Everything is in the map frame (REP 105): metres, radians, x to the right and y upwards on the drawing.
Nothing here knows ROS or the physics engine.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Dict, List, Optional, Tuple, Union

from merlin_reactive.pose import Point, Pose
from merlin_reactive.recognition.object_classes import CLOTHES, PERSON_HEIGHT, PERSON_RADIUS

TOLERANCE = 0.01  # m beside a wall within which a door is in it


@dataclass(frozen=True)
class Solid:
    """A box (size x, y, height) or an upright cylinder (radius, height) that stands on the floor.

    :param mass: kg, of a thing that robots can push; 0: it does not give way.
    """

    name: str
    pose: Pose
    height: float
    size: Optional[Tuple[float, float]] = None  # m, of a box
    radius: Optional[float] = None  # m, of a cylinder
    color: str = "#9a9a9a"
    mass: float = 0.0

    @property
    def half_size(self) -> Tuple[float, float]:
        """Half of its extent along its own x and y axes, m."""
        if self.radius is not None:
            return self.radius, self.radius
        assert self.size is not None, f"{self.name} has neither a size nor a radius"
        return self.size[0] / 2, self.size[1] / 2

    def corners(self) -> List[Point]:
        """Its outline as a polygon, counter-clockwise."""
        if self.radius is not None:
            angles = [2 * math.pi * i / 24 for i in range(24)]
            return [
                (self.pose.x + self.radius * math.cos(a), self.pose.y + self.radius * math.sin(a))
                for a in angles
            ]
        half_x, half_y = self.half_size
        local = [(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)]
        return [self.pose.compose(Pose(x, y)).point for x, y in local]

    def distance(self, point: Point) -> float:
        """How far a point lies outside its outline, m; negative inside."""
        local = self.pose.inverse().compose(Pose(*point))
        if self.radius is not None:
            return math.hypot(local.x, local.y) - self.radius
        half_x, half_y = self.half_size
        beside = (abs(local.x) - half_x, abs(local.y) - half_y)
        return math.hypot(max(beside[0], 0.0), max(beside[1], 0.0)) + min(max(beside), 0.0)

    def moved(self, pose: Pose) -> "Solid":
        """A copy at another place."""
        return replace(self, pose=pose)


@dataclass(frozen=True)
class Door:
    """A sliding door: an opening in a wall that its leaf fills when it is closed."""

    name: str
    start: Point
    end: Point
    open: bool = True

    def leaf(self, thickness: float, height: float) -> Solid:
        """The closed door as a thing that stands in the way."""
        return segment_solid(self.name, self.start, self.end, thickness, height, "#c08a4a")


@dataclass(frozen=True)
class Wall:
    """A straight wall between two points."""

    start: Point
    end: Point


@dataclass(frozen=True)
class Person:
    """A person that stands, or walks a path there and back again.

    :param speed: m/s.
    :param delay: s of simulated time before the first step.
    :param pause: s at each end of the path.
    :param polite: stops for robots that are in the way.
    :param absent: the world begins without it.
    """

    name: str
    path: Tuple[Point, ...]
    speed: float = 0.6
    delay: float = 0.0
    pause: float = 2.0
    polite: bool = True
    radius: float = PERSON_RADIUS
    height: float = PERSON_HEIGHT
    absent: bool = False

    def solid(self, pose: Pose) -> Solid:
        """The person at a pose."""
        return Solid(self.name, pose, self.height, radius=self.radius, color=CLOTHES)


@dataclass(frozen=True)
class WorldObject:
    """A small thing that can be recognised: a cup on a table, a box on the floor.

    :param kind: its class, such as cup; several objects may share one.
    :param bottom: m above the floor at which it stands.
    :param support: the furniture that it stands on; None: it stands at `bottom` by itself.
    :param tag: number of the ArUco tag (4x4) on it, if there is one.
    :param absent: the world begins without it.
    """

    kind: str
    solid: Solid
    bottom: float = 0.0
    support: Optional[str] = None
    tag: Optional[int] = None
    absent: bool = False

    @property
    def name(self) -> str:
        """Its name, unlike that of any other thing of the world."""
        return self.solid.name


@dataclass(frozen=True)
class DoorEvent:
    """A door that opens or closes at a moment of simulated time, s."""

    at: float
    door: str
    open: bool


@dataclass(frozen=True)
class MoveEvent:
    """A piece of furniture that stands somewhere else from a moment of simulated time on, s."""

    at: float
    thing: str
    to: Pose


WorldEvent = Union[DoorEvent, MoveEvent]


@dataclass
class World:
    """A world as its file describes it, before anything moves."""

    name: str
    walls: List[Wall]
    wall_thickness: float
    wall_height: float
    doors: List[Door] = field(default_factory=list)
    furniture: List[Solid] = field(default_factory=list)
    unmapped: List[Solid] = field(default_factory=list)  # stands there, but not on the map
    people: List[Person] = field(default_factory=list)
    objects: List[WorldObject] = field(default_factory=list)
    events: List[WorldEvent] = field(default_factory=list)
    points_of_interest: Dict[str, Pose] = field(default_factory=dict)
    starts: List[Pose] = field(default_factory=list)
    resolution: float = 0.05  # m per cell of the map

    def wall_solids(self) -> List[Solid]:
        """The walls with the openings of the doors cut out."""
        thickness, height, pieces = self.wall_thickness, self.wall_height, []
        for index, wall in enumerate(self.walls):
            for piece, (start, end) in enumerate(_cut(wall, self.doors)):
                # Half a thickness more at each end closes the corners; an opening keeps its width.
                more = (thickness / 2 * (start == wall.start), thickness / 2 * (end == wall.end))
                name = f"wall_{index}_{piece}"
                pieces.append(segment_solid(name, start, end, thickness, height, "#5b5b5b", more))
        return pieces

    def bounds(self) -> Tuple[float, float, float, float]:
        """The smallest rectangle around the walls: min x, min y, max x, max y."""
        xs = [point[0] for wall in self.walls for point in (wall.start, wall.end)]
        ys = [point[1] for wall in self.walls for point in (wall.start, wall.end)]
        return min(xs), min(ys), max(xs), max(ys)


def segment_solid(
    name: str,
    start: Point,
    end: Point,
    thickness: float,
    height: float,
    color: str,
    extend: Tuple[float, float] = (0.0, 0.0),
) -> Solid:
    """A box along a segment, lengthened by `extend` (m) at its two ends."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = math.hypot(dx, dy)
    ux, uy = dx / length, dy / length
    shift = (extend[1] - extend[0]) / 2
    pose = Pose(
        (start[0] + end[0]) / 2 + ux * shift, (start[1] + end[1]) / 2 + uy * shift, math.atan2(dy, dx)
    )
    return Solid(name, pose, height, size=(length + sum(extend), thickness), color=color)


def _cut(wall: Wall, doors: List[Door]) -> List[Tuple[Point, Point]]:
    """The pieces of a wall that its doors leave."""
    (x0, y0), (x1, y1) = wall.start, wall.end
    length = math.hypot(x1 - x0, y1 - y0)
    ux, uy = (x1 - x0) / length, (y1 - y0) / length

    def at(distance: float) -> Point:
        if distance <= 0.0:
            return wall.start
        return wall.end if distance >= length else (x0 + ux * distance, y0 + uy * distance)

    openings = sorted(span for door in doors for span in [span_on(wall, door)] if span is not None)
    pieces = []
    begin = 0.0
    for first, last in openings:
        if first > begin:
            pieces.append((at(begin), at(first)))
        begin = max(begin, last)
    if begin < length:
        pieces.append((at(begin), at(length)))
    return pieces


def span_on(wall: Wall, door: Door) -> Optional[Tuple[float, float]]:
    """Where along a wall (m from its start) a door lies, or None when it is not in this wall."""
    (x0, y0), (x1, y1) = wall.start, wall.end
    length = math.hypot(x1 - x0, y1 - y0)
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    along = []
    for x, y in (door.start, door.end):
        if abs((x - x0) * uy - (y - y0) * ux) > TOLERANCE:
            return None
        along.append((x - x0) * ux + (y - y0) * uy)
    first, last = sorted(along)
    return (first, last) if first >= -TOLERANCE and last <= length + TOLERANCE else None
