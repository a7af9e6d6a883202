# SPDX-License-Identifier: Apache-2.0
"""Where everything in a simulated world is now; only this class moves it.

The physics engine pushes what has a mass; this follows, and takes along what stands on it or on a robot.
"""

from dataclasses import dataclass, replace
from typing import Dict, Iterator, List, Optional, Tuple

from merlin_reactive.pose import Point, Pose, wrap
from merlin_reactive.recognition.object_classes import PERSON
from merlin_sim.engine.physics import Physics, RobotBody
from merlin_sim.robot.lidar import ScanOutlines
from merlin_sim.world.world_model import Solid, World, WorldObject
from merlin_sim.world.world_places import ROBOT_RADIUS

PUSHED = 0.002  # m and rad that a thing has to move before its new place is published
ROBOT_HEIGHT = 1.42  # m, to the top of its camera
LASER_HEIGHT = 0.33  # m
TRAY = Pose(0.08, 0.0)  # its middle, in the robot's frame
TRAY_HEIGHT, TRAY_RADIUS = 0.40, 0.17  # m


@dataclass(frozen=True)
class PlacedObject:
    """An object and where it stands.

    :param local: its pose on what it stands on; in the map frame when that is nothing.
    :param height: m above what it stands on.
    """

    thing: WorldObject
    local: Pose
    height: float
    there: bool = True

    @property
    def support(self) -> Optional[str]:
        """What it stands on."""
        return self.thing.support


class Scene:
    """The things of a world: their poses, and which thing carries which.

    :param robots: by what they are called here; see :data:`merlin_sim.world.world_places.ROBOT`.
    """

    def __init__(self, world: World, physics: Physics, robots: Dict[str, RobotBody]) -> None:
        self.physics = physics
        self.robots = robots
        self.outlines = ScanOutlines(LASER_HEIGHT)
        self.movable = [solid.name for solid in world.furniture + world.unmapped if solid.mass]
        self.furniture: Dict[str, Solid] = {}  # where it is now, or was when it went
        self._there: Dict[str, Solid] = {}  # all present things on the floor, but robots and objects
        self.objects: Dict[str, PlacedObject] = {}
        for solid in [*world.furniture, *world.unmapped]:
            self.furniture[solid.name] = solid
            self.put_solid(solid, True)
        for solid in world.wall_solids():
            self.put_solid(solid, True)
        for door in world.doors:
            self.put_solid(door.leaf(world.wall_thickness, world.wall_height), not door.open)
        for thing in world.objects:
            support = self.furniture.get(thing.support or "")
            pose, height = thing.solid.pose, thing.bottom
            if support is not None:
                pose, height = support.pose.inverse().compose(pose), height - support.height
            self.put(PlacedObject(thing, pose, height, not thing.absent))

    def put_solid(self, solid: Solid, there: bool, bottom: float = 0.0) -> None:
        """Puts a thing that stands on the floor where it says, or takes it away."""
        self.physics.put_solid(solid, there, bottom)
        if solid.name in self.furniture:
            self.furniture[solid.name] = solid
        if there:
            self._there[solid.name] = solid
            self.outlines.add(solid)
        else:
            self._there.pop(solid.name, None)
            self.outlines.remove(solid.name)
        self._take_along(solid.name)

    def put(self, thing: PlacedObject) -> None:
        """Puts an object somewhere; a new one comes into the world."""
        self.objects[thing.thing.name] = thing
        self._settle(thing.thing.name)

    def add_person(self, solid: Solid) -> None:
        """A body for a new person, which is not in the world yet."""
        self.physics.add(solid, kind=PERSON)
        self.put_solid(solid, False)

    def follow(self) -> None:
        """Sees where things were pushed to, and takes along what stands on them."""
        for name in self.movable:
            if name not in self._there:
                continue
            seen, pose = self._there[name], self.physics.place_of(name)
            if pose.distance(seen.pose) > PUSHED or abs(wrap(pose.yaw - seen.pose.yaw)) > PUSHED:
                self._there[name] = self.furniture[name] = seen.moved(pose)
                self.outlines.add(self._there[name])
                self._take_along(name)

    def carry(self) -> None:
        """Takes along what stands on robots."""
        for name, thing in self.objects.items():
            if thing.there and thing.support in self.robots:
                self._settle(name)

    def is_there(self, name: str) -> bool:
        """Whether something that stands on the floor is there."""
        return name in self._there

    def standing(self) -> Iterator[Solid]:
        """All that stands on the floor now, but robots and objects."""
        return iter(self._there.values())

    def robot_solids(self) -> List[Solid]:
        """The robots as upright cylinders."""
        return [
            Solid(name, body.pose(), ROBOT_HEIGHT, radius=ROBOT_RADIUS) for name, body in self.robots.items()
        ]

    def robots_block(self, here: Point, there: Point, room: float) -> str:
        """The robot that a step leads too near to, `room` m between its middle and the step's end."""
        for name, body in self.robots.items():
            place = body.pose()
            distance = place.distance(Pose(*there))
            if distance < room and distance < place.distance(Pose(*here)):
                return name
        return ""

    def top(self, support: str) -> Tuple[Pose, float]:
        """The pose and the height (m) of the surface of furniture or of a robot's tray.

        :raises KeyError: there is nothing of this name that carries things.
        """
        if support in self.robots:
            return self.robots[support].pose().compose(TRAY), TRAY_HEIGHT
        solid = self.furniture[support]
        return solid.pose, solid.height

    def where(self, thing: PlacedObject) -> Tuple[Solid, float]:
        """An object where it is now (or would be), and its height above the floor, m."""
        if thing.support is None:
            return thing.thing.solid.moved(thing.local), thing.height
        pose, height = self.top(thing.support)
        return thing.thing.solid.moved(pose.compose(thing.local)), height + thing.height

    def _take_along(self, support: str) -> None:
        for name, thing in self.objects.items():
            if thing.support == support:
                self._settle(name)

    def _settle(self, name: str) -> None:
        thing = self.objects[name]
        solid, bottom = self.where(thing)
        self.objects[name] = replace(thing, thing=replace(thing.thing, solid=solid, bottom=bottom))
        carried = thing.support in self.robots or thing.support in self.movable
        gone = thing.support in self.furniture and not self.is_there(thing.support)
        self.physics.put(self.objects[name].thing, thing.there and not gone, touchable=not carried)
