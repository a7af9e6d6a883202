# SPDX-License-Identifier: Apache-2.0
"""What an application may do to a simulated world while it runs: place things, let people walk.

Between two physics steps and without chance: the same calls at the same simulated times make the same world.
"""

import math
import re
from dataclasses import dataclass, replace
from typing import AbstractSet, Dict, Iterable, List, Optional, Sequence, Set

from merlin_reactive.pose import Point, Pose
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES, PERSON
from merlin_sim.engine.scene import TRAY_RADIUS, PlacedObject, Scene
from merlin_sim.people.walkers import ROOM, Patrol, Walk, Walker, WalkState
from merlin_sim.world.footprints import collide
from merlin_sim.world.world_model import Person, Solid, World, WorldObject
from merlin_sim.world.world_places import ROBOT_RADIUS

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*\Z")
MAX_SPEED = 3.0  # m/s of a person
MAX_HEIGHT = 10.0  # m
NOWHERE = Pose(0.0, 0.0)


class ChangeRefused(ValueError):
    """What was asked for cannot be; the text is a sentence that says why."""


@dataclass(frozen=True)
class Placing:
    """What is to be put where; the fields are those of merlin_msgs/PlaceThing."""

    name: str
    kind: str = ""
    absent: bool = False
    on: str = ""
    pose: Pose = NOWHERE
    z: float = 0.0
    sit: bool = False


class WorldControl:
    """Changes one world at run time and walks its people."""

    def __init__(self, world: World, scene: Scene) -> None:
        self._world = world
        self._scene = scene
        self._people: Dict[str, Walker] = {}
        self._seated: Dict[str, Set[str]] = {}  # by person: the furniture that is in the same place
        self.changes = 0  # of what people do; grows
        for person in world.people:
            walker = self._people[person.name] = Walker(person, Patrol(person, self._robot_blocks))
            self._put_walker(walker)

    @property
    def people(self) -> List[Walker]:
        """All persons, in the order of the world file, then of their first placing."""
        return list(self._people.values())

    def step(self, now: float, elapsed: float) -> None:
        """Moves people on their walks by `elapsed` s."""
        for walker in self._people.values():
            did = (walker.state, walker.waits_for)
            if walker.step(now, elapsed):
                self._put_walker(walker)
            if did != (walker.state, walker.waits_for):
                self.changes += 1
                if walker.state is not WalkState.WALKING:
                    self._let_pass(walker, self._within(walker))

    def place(self, what: Placing) -> None:
        """Puts a person, an object or movable furniture somewhere, or takes it away.

        :raises ChangeRefused: it is unknown, cannot be moved, or cannot be there; nothing has changed then.
        """
        if what.absent:
            what = replace(what, on="", pose=NOWHERE, z=0.0)
        for value in (what.pose.x, what.pose.y, what.pose.yaw, what.z):
            if not math.isfinite(value):
                raise ChangeRefused(f"{what.name}: {value} is not a place")
        name = what.name
        if name in self._people or (what.kind == PERSON and self._is_new(name)):
            self._expect_kind(what, PERSON)
            self._place_person(what)
        elif name in self._scene.furniture:
            self._expect_kind(what, "")
            self._place_furniture(what)
        elif name in self._scene.objects:
            self._expect_kind(what, self._scene.objects[name].thing.kind)
            self._place_object(what, self._scene.objects[name].thing)
        elif what.kind and self._is_new(name):
            self._place_object(what, self._another(what.kind, name))
        else:
            raise ChangeRefused(
                f"there is no person, object or furniture {name!r} in this world; a new one needs a kind"
            )

    def walk(
        self,
        name: str,
        path: Sequence[Point],
        speed: float = 0.0,
        sit: bool = False,
        yaw: Optional[float] = None,
    ) -> int:
        """Starts a walk of a person; an empty path stops.

        :param speed: m/s; 0: the person's own.
        :param sit: sits down at the end.
        :param yaw: heading at the end, rad; None: as the person came.
        :return: the number of the walk.
        :raises ChangeRefused: as :meth:`place`.
        """
        walker = self._people.get(name)
        if walker is None:
            raise ChangeRefused(f"there is no person {name!r} in this world")
        if walker.state is WalkState.ABSENT:
            raise ChangeRefused(f"{name} is absent and cannot walk")
        for value in [speed, yaw or 0.0, *(value for point in path for value in point)]:
            if not math.isfinite(value):
                raise ChangeRefused(f"{name} cannot walk: {value} is not a number to use")
        if not 0.0 <= speed <= MAX_SPEED:
            raise ChangeRefused(f"{name} cannot walk at {speed:g} m/s; 0 (their own speed) to {MAX_SPEED:g}")
        for point in path:
            self._expect_inside(name, Pose(*point))
        self.changes += 1
        if not path:
            number = walker.stop()
            self._let_pass(walker, self._within(walker))
            return number
        goal = Pose(*path[-1])
        seats = self._seats(goal) if sit else []
        clash = self._clash(walker.person.solid(goal), seats)
        if clash:
            raise ChangeRefused(f"{name} cannot get to ({goal.x:g}, {goal.y:g}): {clash} is there")
        passable = {*seats, *self._within(walker)}
        self._let_pass(walker, passable)

        def blocked(here: Point, there: Point) -> str:
            return self._robot_blocks(here, there) or self._solid_blocks(here, there, walker, passable)

        walk = Walk([walker.pose.point, *path], speed or walker.person.speed, blocked)
        number = walker.start(walk, sit, yaw)
        self._put_walker(walker)
        return number

    def _place_person(self, what: Placing) -> None:
        known = self._people.get(what.name)
        person = known.person if known else Person(what.name, (what.pose.point,), absent=True)
        if what.on or what.z:
            raise ChangeRefused(f"{what.name} is a person and stands on the floor")
        seats = self._seats(what.pose) if what.sit else []
        if not what.absent:
            self._expect_room(person.solid(what.pose), seats)
        if known is None:
            known = self._people[what.name] = Walker(person)
            self._scene.add_person(person.solid(what.pose))
        self._let_pass(known, [] if what.absent else seats)
        if what.absent:
            known.place(known.pose, WalkState.ABSENT)
        else:
            known.place(what.pose, WalkState.SITTING if what.sit else WalkState.STANDING)
        self._put_walker(known)
        self.changes += 1

    def _place_furniture(self, what: Placing) -> None:
        solid = self._scene.furniture[what.name]
        if not solid.mass:
            raise ChangeRefused(f"{what.name} cannot be moved: it has no mass in the world file")
        if what.on or what.z:
            raise ChangeRefused(f"{what.name} is furniture and stands on the floor")
        if what.absent:
            self._scene.put_solid(solid, False)
            return
        self._expect_room(solid.moved(what.pose), [what.name])
        self._scene.put_solid(solid.moved(what.pose), True)

    def _place_object(self, what: Placing, thing: WorldObject) -> None:
        if what.absent:
            placed = self._scene.objects.get(what.name)
            placed = placed or PlacedObject(replace(thing, support=None), what.pose, what.z)
            self._scene.put(replace(placed, there=False))
            return
        if not 0.0 <= what.z <= MAX_HEIGHT:
            raise ChangeRefused(f"{what.name} cannot stand {what.z:g} m high; 0 to {MAX_HEIGHT:g}")
        thing = replace(thing, support=what.on or None)
        placed = PlacedObject(thing, what.pose, what.z)
        if what.on:
            self._expect_on(what)
        solid, bottom = self._scene.where(placed)
        self._expect_inside(what.name, solid.pose)
        for other in self._scene.objects.values():
            stands = other.there and other.thing.name != what.name
            if stands and collide(solid, other.thing.solid, bottom, other.thing.bottom):
                raise ChangeRefused(f"{what.name} cannot stand there: {other.thing.name} does")
        if what.on not in self._scene.robots:
            for body in self._bodies():
                if collide(solid, body, bottom):
                    raise ChangeRefused(f"{what.name} cannot stand there: {body.name} is there")
        self._scene.put(placed)

    def _expect_on(self, what: Placing) -> None:
        scene = self._scene
        if what.on in scene.robots:
            if math.hypot(what.pose.x, what.pose.y) > TRAY_RADIUS:
                raise ChangeRefused(f"{what.name} would fall off the tray, whose radius is {TRAY_RADIUS:g} m")
            return
        support = scene.furniture.get(what.on)
        if support is None:
            raise ChangeRefused(
                f"{what.name} cannot stand on {what.on!r}: there is no such furniture or robot"
            )
        if not scene.is_there(what.on):
            raise ChangeRefused(f"{what.name} cannot stand on {what.on}, which is absent")
        place = support.pose.compose(what.pose)
        if support.distance(place.point) > 0.0:
            raise ChangeRefused(
                f"{what.name} would stand beside {what.on}, not on it: x and y count from its middle"
            )

    def _bodies(self) -> List[Solid]:
        return [*self._scene.standing(), *self._scene.robot_solids()]

    def _expect_room(self, solid: Solid, passable: Sequence[str]) -> None:
        self._expect_inside(solid.name, solid.pose)
        clash = self._clash(solid, passable, movable=True)
        if clash:
            where = f"({solid.pose.x:g}, {solid.pose.y:g})"
            raise ChangeRefused(f"{solid.name} cannot be at {where}: {clash} is there")

    def _clash(self, solid: Solid, passable: Sequence[str], movable: bool = False) -> str:
        """What a body that stands on the floor would be in.

        :param movable: people, robots and objects, which may go away, count as well.
        """
        for other in self._bodies() if movable else self._scene.standing():
            skip = other.name == solid.name or other.name in passable
            if not skip and (movable or other.name not in self._people) and collide(solid, other):
                return other.name
        if movable:
            own = {solid.name, *passable, *self._scene.robots}
            for placed in self._scene.objects.values():
                thing = placed.thing
                if (
                    placed.there
                    and placed.support not in own
                    and collide(solid, thing.solid, 0.0, thing.bottom)
                ):
                    return thing.name
        return ""

    def _seats(self, place: Pose, radius: float = 0.0) -> List[str]:
        """The furniture that a person at a place sits on, or is in the same place with."""
        return [
            solid.name
            for solid in self._scene.standing()
            if solid.name in self._scene.furniture and solid.distance(place.point) < radius
        ]

    def _within(self, walker: Walker) -> List[str]:
        return self._seats(walker.pose, walker.person.radius)

    def _let_pass(self, walker: Walker, furniture: Iterable[str]) -> None:
        name = walker.person.name
        before, now = self._seated.get(name, set()), set(furniture)
        for thing in sorted(before ^ now):
            self._scene.physics.let_pass(name, thing, thing in now)
        self._seated[name] = now

    def _robot_blocks(self, here: Point, there: Point) -> str:
        return self._scene.robots_block(here, there, ROBOT_RADIUS + Person.radius + ROOM)

    def _solid_blocks(self, here: Point, there: Point, walker: Walker, passable: AbstractSet[str]) -> str:
        for solid in self._scene.standing():
            if solid.name in passable or solid.name in self._people:
                continue
            distance = solid.distance(there)
            if distance < walker.person.radius and distance < solid.distance(here):
                return solid.name
        return ""

    def _put_walker(self, walker: Walker) -> None:
        self._scene.put_solid(walker.solid, walker.state is not WalkState.ABSENT, walker.bottom)

    def _is_new(self, name: str) -> bool:
        """Whether the name is free; a malformed name is refused."""
        if not NAME.match(name):
            raise ChangeRefused(f"{name!r} is not a name: a letter, then letters, digits, _ and -")
        scene = self._scene
        taken = {solid.name for solid in scene.standing()} | {door.name for door in self._world.doors}
        if name in taken or name in scene.robots:
            raise ChangeRefused(f"{name} is part of the building or a robot, and cannot be placed")
        return name not in self._people and name not in scene.objects and name not in scene.furniture

    def _another(self, kind: str, name: str) -> WorldObject:
        """A new object of a class: like one of the world file, or like its class looks."""
        for thing in self._world.objects:
            if thing.kind == kind:
                return replace(thing, solid=replace(thing.solid, name=name), support=None)
        known = OBJECT_CLASSES.get(kind)
        if known is None:
            kinds = sorted({PERSON, *OBJECT_CLASSES, *(thing.kind for thing in self._world.objects)})
            raise ChangeRefused(f"{name}: there is no kind {kind!r}; known are {', '.join(kinds)}")
        solid = Solid(name, NOWHERE, known.height, size=known.size, radius=known.radius, color=known.color)
        return WorldObject(kind, solid)

    def _expect_kind(self, what: Placing, kind: str) -> None:
        if what.kind and what.kind != kind:
            raise ChangeRefused(f"{what.name} is {kind or 'furniture'}, not {what.kind}")

    def _expect_inside(self, name: str, pose: Pose) -> None:
        left, bottom, right, top = self._world.bounds()
        if not (left < pose.x < right and bottom < pose.y < top):
            raise ChangeRefused(f"{name} cannot be at ({pose.x:g}, {pose.y:g}): that lies outside the walls")
