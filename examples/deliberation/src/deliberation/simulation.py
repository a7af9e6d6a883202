# SPDX-License-Identifier: Apache-2.0
"""One robot in a world of pyrobosim, without a window. Needs pyrobosim; without ROS."""

import importlib.metadata
import math
import re
from pathlib import Path
from typing import Any, List, Tuple

from deliberation.house import ACTIONS, House, Site, State
from deliberation.world_file import WorldError, read_world, seeded

VERSION = "5.0.1"
HOW = "run `make build PROFILE=robot+deliberation`"


def check_pyrobosim() -> None:
    """Looks whether pyrobosim is there.

    :raises WorldError: when it is not, or has another version.
    """
    try:
        found = importlib.metadata.version("pyrobosim")
    except importlib.metadata.PackageNotFoundError:
        raise WorldError(f"pyrobosim is not installed; {HOW}") from None
    if found != VERSION:
        raise WorldError(f"pyrobosim {found} is installed, and {VERSION} is needed; {HOW}")


class Simulation:
    """A world and its first robot. Names are in small letters; a location with one spot has its own name.

    :param file: world file.
    :param seed: of where things are, of paths and of dice.
    :param rtf: simulated seconds per second.
    :raises WorldError: when pyrobosim or the file cannot be used.
    """

    def __init__(self, file: Path, seed: int, rtf: float) -> None:
        check_pyrobosim()
        data = seeded(read_world(file), seed, rtf)
        try:  # only here: all else, and what says that it is missing, runs without it
            import numpy
            from pyrobosim.core import WorldYamlLoader
        except ImportError as error:
            raise WorldError(f"pyrobosim cannot be imported: {error}; {HOW}") from error
        numpy.random.seed(seed)
        try:
            self._world: Any = WorldYamlLoader().from_yaml(data, file.resolve().parent)
            self._robot: Any = self._world.robots[0]
            self.house = self._house()
        except Exception as error:  # of another's reader: whatever it stumbles over
            reason = " ".join(str(error).split()) or "no reason given"
            raise WorldError(
                f"pyrobosim cannot load the world {file}: {type(error).__name__}: {reason}"
            ) from error
        self._rtf = rtf

    def _house(self) -> House:
        self._entities = {}
        sites = {}
        for door in self._world.hallways:
            middle = door.points[len(door.points) // 2 - 1], door.points[len(door.points) // 2]
            x, y = ((first + second) / 2 for first, second in zip(*middle))
            self._entities[pddl_name(door.name)] = door
            rooms = tuple(pddl_name(room.name) for room in (door.room_start, door.room_end))
            sites[pddl_name(door.name)] = Site("door", rooms, float(x), float(y))
        for location in self._world.locations:
            for spawn in location.children:
                name = pddl_name(location.name if len(location.children) == 1 else spawn.name)
                self._entities[name] = spawn
                kind = "charger" if location.is_charger else "spot"
                rooms = (pddl_name(location.parent.name),)
                sites[name] = Site(kind, rooms, float(spawn.pose.x), float(spawn.pose.y))
        options = self._robot.action_execution_options
        return House(
            tuple(pddl_name(room.name) for room in self._world.rooms),
            sites,
            {action: float(options[action].success_probability) for action in ACTIONS},
            {action: float(options[action].battery_usage) for action in ACTIONS},
        )

    def pose(self) -> Tuple[float, float, float]:
        """Where the robot is, m and rad, frame of the world."""
        pose = self._robot.get_pose()
        return float(pose.x), float(pose.y), float(pose.get_yaw())

    def floor(self, cell: float) -> Tuple[float, float, Any]:
        """What is free (0) and what is not (100), rows from the south, and x and y of the first corner, m.

        :param cell: m.
        """
        import numpy
        import shapely

        world, margin = self._world, 5 * cell
        low = world.x_bounds[0] - margin, world.y_bounds[0] - margin
        high = world.x_bounds[1] + margin, world.y_bounds[1] + margin
        x, y = numpy.meshgrid(*(numpy.arange(a + cell / 2, b, cell) for a, b in zip(low, high)))
        free = shapely.union_all([each.polygon for each in (*world.rooms, *world.hallways)])
        full = shapely.union_all([each.polygon for each in world.locations])
        inside = shapely.contains_xy(free, x, y) & ~shapely.contains_xy(full, x, y)
        return float(low[0]), float(low[1]), numpy.where(inside, 0, 100)

    def state(self) -> State:
        """What is true now."""
        pose, robot = self._robot.get_pose(), self._robot
        site = self._name_of(robot.location)
        held = robot.manipulated_object
        return State(
            site=site,
            room=self._room(site, (pose.x, pose.y)),
            x=float(pose.x),
            y=float(pose.y),
            holding=pddl_name(held.name) if held is not None else "",
            battery=float(robot.battery_level),
            open=frozenset(
                name
                for name, entity in self._entities.items()
                if entity.is_open and self.house.sites[name].kind != "charger"
            ),
            things={
                pddl_name(each.name): "" if each is held else self._name_of(each.parent)
                for each in self._world.objects
            },
        )

    def _name_of(self, entity: Any) -> str:
        return next((name for name, each in self._entities.items() if each is entity), "")

    def _room(self, site: str, point: Tuple[float, float]) -> str:
        """The room of the robot; before or in a door the one whose side is nearer."""
        if site and self.house.sites[site].kind != "door":
            return self.house.sites[site].rooms[0]
        if site:
            door = self._entities[site]
            far = [math.dist(point, (pose.x, pose.y)) for pose in (door.nav_poses[0], door.nav_poses[-1])]
            return self.house.sites[site].rooms[far.index(min(far))]
        inside = [room for room in self._world.rooms if room.is_collision_free(point)]
        return pddl_name(inside[0].name) if inside else ""

    def act(self, action: str, target: str) -> Tuple[str, List[str]]:
        """Does one action, to its end or to :meth:`stop`.

        :param action: one of :data:`deliberation.house.ACTIONS`.
        :param target: a site of navigate, open and close, a thing of pick and place; unused by detect.
        :return: why it failed, empty when it did not; the things that detect saw.
        """
        from pyrobosim.planning.actions import TaskAction

        entity: Any = None
        if action == "navigate":
            entity = self._entities.get(target)
            if entity is None:
                return f"there is no site {target}", []
        elif action == "pick":
            entity = next((each for each in self._world.objects if pddl_name(each.name) == target), None)
            if entity is None:
                return f"there is no thing {target}", []
        elif action != "detect":
            state = self.state()
            here = state.holding if action == "place" else state.site
            if here != target:
                does = "holds" if action == "place" else "is at"
                return f"the robot {does} {here or 'nothing'}, not {target}", []
        task = TaskAction(action, object=entity if action == "pick" else None, target_location=entity)
        result = self._robot.execute_action(task, realtime_factor=self._rtf)
        if not result.is_success():
            return str(result.message or result.status.name.lower()), []
        if action == "navigate" and self._name_of(self._robot.location) != target:
            return f"the robot did not arrive at {target}", []
        site = self._name_of(self._robot.location)
        if action in ("open", "close") and self.house.sites[site].kind == "door":
            self._robot.reset_path_planner()  # its map of the house has the door as it was
        seen = self._robot.last_detected_objects if action == "detect" else ()
        return "", [pddl_name(each.name) for each in seen]

    def stop(self) -> None:
        """Asks a drive to stop. Before it begins that is forgotten: call it until the action has ended."""
        if self._robot.path_executor is not None:
            self._robot.path_executor.cancel_execution = True

    def end(self) -> None:
        """Ends the threads of the world."""
        self._world.shutdown()


def pddl_name(name: str) -> str:
    """A name of pyrobosim as one of PDDL."""
    return re.sub(r"[^a-z0-9_-]", "_", str(name).lower())
