"""What moves in a world besides its robots: people, doors, furniture.

Everything happens at moments of simulated time. Two things wait for robots: a door does not close on one, and
a polite person does not walk into one.
"""

import math
from typing import Callable, Iterable, List

from merlin_sim.path_follower import Path
from merlin_sim.world import DoorEvent, MoveEvent, Person, Point, Pose, Solid, World, WorldEvent

ROOM = 0.15  # m that a person keeps from a robot, and a door's leaf

Show = Callable[[Solid, bool], None]  # puts a thing where it says, or takes it away


class Walker:
    """A person on the way along a path, there and back."""

    def __init__(self, person: Person) -> None:
        self.person = person
        self._path = Path(person.path)
        self._walked = 0.0  # s of walking and pausing; time spent waiting for robots does not count
        self.pose = Pose(*person.path[0])

    def step(self, now: float, elapsed: float, robots: Iterable[Point], robot_radius: float) -> bool:
        """Lets time pass; returns whether the person moved."""
        if now < self.person.delay or self._path.length == 0.0:
            return False
        next_pose = self._at(self._walked + elapsed)
        if self.person.polite:
            room = self.person.radius + robot_radius + ROOM
            for robot in robots:
                distance = math.dist(robot, next_pose.point)
                if distance < room and distance < math.dist(robot, self.pose.point):
                    return False
        self._walked += elapsed
        moved = next_pose != self.pose
        self.pose = next_pose
        return moved

    def _at(self, walked: float) -> Pose:
        way = self._path.length / self.person.speed
        phase = walked % (2 * (way + self.person.pause))
        back = phase > way + self.person.pause
        along = min(phase - (way + self.person.pause) if back else phase, way) * self.person.speed
        along = self._path.length - along if back else along
        x, y = self._path.at(along)
        return Pose(float(x), float(y))


class WorldEvents:
    """Plays the events of a world and walks its people.

    :param show: does what happens to the physical world.
    """

    def __init__(self, world: World, show: Show) -> None:
        self._world = world
        self._show = show
        self._pending: List[WorldEvent] = list(world.events)
        self._walkers = [Walker(person) for person in world.people]

    def step(self, now: float, elapsed: float, robots: List[Point], robot_radius: float) -> None:
        """Does what is due at a time (s), `elapsed` seconds after the last call."""
        while self._pending and self._pending[0].at <= now:
            if not self._happen(self._pending[0], robots, robot_radius):
                break
            self._pending.pop(0)
        for walker in self._walkers:
            if walker.step(now, elapsed, robots, robot_radius):
                self._show(walker.person.solid(walker.pose), True)

    def _happen(self, event: WorldEvent, robots: List[Point], robot_radius: float) -> bool:
        """Plays an event; False when a robot is in its way."""
        world = self._world
        if isinstance(event, DoorEvent):
            door = next(door for door in world.doors if door.name == event.door)
            if not event.open:
                way = Path([door.start, door.end])
                if any(way.nearest(robot, 0.0, way.length)[1] < robot_radius + ROOM for robot in robots):
                    return False
            self._show(door.leaf(world.wall_thickness, world.wall_height), not event.open)
        elif isinstance(event, MoveEvent):
            thing = next(solid for solid in world.furniture + world.unmapped if solid.name == event.thing)
            self._show(thing.moved(event.to), True)
        return True
