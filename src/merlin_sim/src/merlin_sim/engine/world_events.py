# SPDX-License-Identifier: Apache-2.0
"""What a world file says will happen: doors that open and close, furniture that is moved.

Everything happens at moments of simulated time; only a door waits, as it does not close on a robot.
"""

from typing import Callable, List, Set

from merlin_reactive.navigation.path_follower import Path
from merlin_reactive.pose import Point
from merlin_sim.world.world_model import DoorEvent, MoveEvent, Solid, World, WorldEvent

ROOM = 0.15  # m that a door's leaf keeps from a robot

PutSolid = Callable[[Solid, bool], None]  # puts a thing where it says, or takes it away


class WorldEvents:
    """Plays the events of a world.

    :param put_solid: does what happens to the physical world.
    """

    def __init__(self, world: World, put_solid: PutSolid) -> None:
        self._world = world
        self._put_solid = put_solid
        self._pending: List[WorldEvent] = list(world.events)

    def step(self, now: float, robots: List[Point], robot_radius: float) -> None:
        """Applies the events that are due at a time, s."""
        waiting: Set[str] = set()  # doors, whose later events wait as well
        for event in [event for event in self._pending if event.at <= now]:
            door = event.door if isinstance(event, DoorEvent) else ""
            if door not in waiting and self._happen(event, robots, robot_radius):
                self._pending.remove(event)
            elif door:
                waiting.add(door)

    def _happen(self, event: WorldEvent, robots: List[Point], robot_radius: float) -> bool:
        """Plays an event; False when a robot is in its way."""
        world = self._world
        if isinstance(event, DoorEvent):
            door = next(door for door in world.doors if door.name == event.door)
            if not event.open:
                way = Path([door.start, door.end])
                if any(way.nearest(robot, 0.0, way.length)[1] < robot_radius + ROOM for robot in robots):
                    return False
            self._put_solid(door.leaf(world.wall_thickness, world.wall_height), not event.open)
        elif isinstance(event, MoveEvent):
            thing = next(solid for solid in world.furniture + world.unmapped if solid.name == event.thing)
            self._put_solid(thing.moved(event.to), True)
        return True
