# SPDX-License-Identifier: Apache-2.0
"""Reads world files and says clearly what is wrong with one."""

import math
import re
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional, Set, Tuple, Union

import jsonschema
import yaml

from merlin_reactive.pose import Pose
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES
from merlin_sim.world.world_model import (
    Door,
    DoorEvent,
    MoveEvent,
    Person,
    Solid,
    Wall,
    World,
    WorldEvent,
    WorldObject,
    span_on,
)
from merlin_sim.world.world_places import OVERLAP, why_no_place
from merlin_sim.world.world_schema import SCHEMA

REPORTED = 5  # errors reported at once
RESERVED = re.compile(r"wall_\d+_\d+\Z|robot\Z")  # names of walls and of a robot without a namespace
LARGEST = 10**15  # whole number that is surely a mistake
MAX_CELLS = 25_000_000  # of the map: 250 m x 250 m at 0.05 m


class WorldError(Exception):
    """A world that cannot be used; the text names the file, the place in it and what is wrong."""


def load_world(path: Union[str, Path]) -> World:
    """Reads a world file.

    :raises WorldError: when it is missing, not YAML, does not follow the schema or makes no sense.
    """
    return parse_world(_read(path), str(path))


def parse_world(data: Any, source: str = "world") -> World:
    """Makes a world of the content of a file.

    :param source: what error texts call it.
    :raises WorldError: as in :func:`load_world`.
    """
    try:
        unusable = [f"{_place(path)}: {why}" for path, why in _unusable(data)]
    except RecursionError as error:
        raise WorldError(_in_words(source, ["something in it contains itself"])) from error
    if unusable:
        raise WorldError(_in_words(source, unusable))
    errors = sorted(
        jsonschema.Draft7Validator(SCHEMA).iter_errors(data), key=lambda error: list(map(str, error.path))
    )
    if errors:
        raise WorldError(_in_words(source, [f"{_place(error.path)}: {error.message}" for error in errors]))
    wall = data.get("wall", {})
    furniture = data.get("furniture", [])
    world = World(
        name=data["name"],
        walls=[Wall(tuple(item["from"]), tuple(item["to"])) for item in data["walls"]],
        wall_thickness=wall.get("thickness", 0.1),
        wall_height=wall.get("height", 2.2),
        doors=[
            Door(item["name"], tuple(item["from"]), tuple(item["to"]), item.get("open", True))
            for item in data.get("doors", [])
        ],
        furniture=[_solid(item) for item in furniture if _surveyed(item)],
        unmapped=[_solid(item) for item in furniture if not _surveyed(item)],
        people=[_person(item) for item in data.get("people", [])],
        events=sorted(map(_event, data.get("events", [])), key=lambda event: event.at),
        points_of_interest={name: _pose(item) for name, item in data["points_of_interest"].items()},
        starts=[_pose(item) for item in data["starts"]],
        resolution=data.get("resolution", 0.05),
    )
    supports = {solid.name: solid for solid in world.furniture + world.unmapped}
    world.objects = [_object(item, supports) for item in data.get("objects", [])]
    faults = [*_impossible(world), *_misplaced(world, supports)]
    if faults:
        raise WorldError(_in_words(source, faults))
    return world


def file_to_write(text: str) -> Path:
    """The file that a command line names as the one to write.

    :raises argparse.ArgumentTypeError: it is a remapping of ROS.
    """
    if ":=" in text:
        raise ArgumentTypeError(f"{text!r} is a remapping of ROS; give the name or the path of a file")
    return Path(text)


def _read(path: Union[str, Path]) -> Any:
    try:
        return yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise WorldError(f"world file {path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise WorldError(f"world file {path} is not UTF-8 text: {error.reason}") from error
    except RecursionError as error:
        raise WorldError(f"world file {path} is nested too deeply") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise WorldError(
            f"world file {path}{where} is not YAML: {getattr(error, 'problem', error)}"
        ) from error


def _in_words(source: str, problems: List[str]) -> str:
    more = f"; and {len(problems) - REPORTED} more" if len(problems) > REPORTED else ""
    return f"world file {source}: " + "; ".join(problems[:REPORTED]) + more


def _unusable(data: Any, path: Tuple[Any, ...] = ()) -> Iterator[Tuple[Tuple[Any, ...], str]]:
    """Numbers that are not finite, and names that YAML reads as something else; where, and why."""
    too_large = isinstance(data, int) and abs(data) > LARGEST
    if too_large or (isinstance(data, float) and not math.isfinite(data)):
        yield path, f"{math.inf if too_large else data} is not a finite number"
    elif isinstance(data, dict):
        for key, value in data.items():
            if not isinstance(key, str):
                yield path, f"YAML reads a name there as {key}; write it in quotes"
            yield from _unusable(value, (*path, key))
    elif isinstance(data, list):
        for index, value in enumerate(data):
            yield from _unusable(value, (*path, index))


def _place(path: Any) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.lstrip(".") or "the file"


def _pose(item: Dict[str, float]) -> Pose:
    return Pose(float(item["x"]), float(item["y"]), float(item.get("yaw", 0.0)))


def _solid(item: Dict[str, Any]) -> Solid:
    size, radius, height = _shape(item)
    pose, color = Pose(*map(float, item["at"])), item.get("color", Solid.color)
    return Solid(item["name"], pose, height, size, radius, color, float(item.get("mass", 0.0)))


def _surveyed(item: Dict[str, Any]) -> bool:
    """Whether furniture is on the map: what can be pushed away is not, unless the file says so."""
    return bool(item.get("on_map", "mass" not in item))


def _person(item: Dict[str, Any]) -> Person:
    fields = {name: item[name] for name in ("speed", "delay", "pause", "polite", "absent") if name in item}
    return Person(item["name"], tuple((float(x), float(y)) for x, y in item["path"]), **fields)


def _event(item: Dict[str, Any]) -> WorldEvent:
    if "door" in item:
        return DoorEvent(float(item["at"]), item["door"], item["open"])
    return MoveEvent(float(item["at"]), item["move"], Pose(*map(float, item["to"])))


def _impossible(world: World) -> Iterator[str]:
    """What the schema cannot see."""
    for index, wall in enumerate(world.walls):
        if wall.start == wall.end:
            yield f"walls[{index}]: it has no length"
            return
    seen: Set[str] = set()
    for kind, names in (
        ("doors", [door.name for door in world.doors]),
        ("furniture", [solid.name for solid in world.furniture + world.unmapped]),
        ("people", [person.name for person in world.people]),
        ("objects", [thing.name for thing in world.objects]),
    ):
        for name in names:
            if name in seen:
                yield f"{kind}: the name {name} is used twice"
            seen.add(name)
    for name in seen:
        if RESERVED.match(name):
            yield f"{name} is a name of the simulator's own"
    narrow = [door.name for door in world.doors if door.start == door.end]
    if narrow:
        yield f"doors: {narrow[0]} has no width"
        return
    for door in world.doors:
        if all(span_on(wall, door) is None for wall in world.walls):
            yield f"doors: {door.name} lies in no wall"
    doors = {door.name for door in world.doors}
    things = {solid.name for solid in world.furniture + world.unmapped}
    for event in world.events:
        if isinstance(event, DoorEvent) and event.door not in doors:
            yield f"events: there is no door {event.door}"
        elif isinstance(event, MoveEvent) and event.thing not in things:
            yield f"events: there is no furniture {event.thing}"
    left, bottom, right, top = world.bounds()
    places = [(f"people.{person.name}", point) for person in world.people for point in person.path]
    places += [
        (f"events: {event.thing}", event.to.point) for event in world.events if isinstance(event, MoveEvent)
    ]
    for what, (x, y) in places:
        if not (left < x < right and bottom < y < top):
            yield f"{what}: ({x:g}, {y:g}) lies outside the walls"
    if (right - left) * (top - bottom) / world.resolution**2 > MAX_CELLS:
        yield (
            f"walls: {right - left:g} m x {top - bottom:g} m are too large for a map "
            f"of {world.resolution:g} m per cell (at most {MAX_CELLS:,} cells)"
        )
        return
    for name, pose in world.points_of_interest.items():
        reason = why_no_place(world, pose.point, OVERLAP, mapped=True)
        if reason:
            yield f"points_of_interest.{name}: {reason}"
    for index, pose in enumerate(world.starts):
        reason = why_no_place(world, pose.point)
        if reason:
            yield f"starts[{index}]: {reason}"


def _misplaced(world: World, supports: Dict[str, Solid]) -> Iterator[str]:
    """What is wrong with the places of a world's objects, a sentence each."""
    left, bottom, right, top = world.bounds()
    for thing in world.objects:
        pose = thing.solid.pose
        if not thing.solid.height:
            yield (
                f"objects: {thing.name} needs box or cylinder; its class {thing.kind} has no size of its own "
                f"(those that have: {', '.join(OBJECT_CLASSES)})"
            )
        if thing.support is not None and thing.support not in supports:
            yield f"objects: {thing.name} stands on {thing.support}, which is not furniture"
        elif thing.support is not None and supports[thing.support].distance(pose.point) > 0.0:
            yield f"objects: {thing.name} stands beside {thing.support}, not on it"
        elif not (left < pose.x < right and bottom < pose.y < top):
            yield f"objects: {thing.name} at ({pose.x:g}, {pose.y:g}) lies outside the walls"
        if thing.bottom < 0.0:
            yield f"objects: {thing.name} stands {-thing.bottom:g} m below the floor"


def _object(item: Dict[str, Any], supports: Dict[str, Solid]) -> WorldObject:
    """Makes an object of the list `objects` of a world file that follows the schema.

    With `support`, the place is given in m from the middle of that furniture, along its own axes. A class of
    :mod:`merlin_reactive.recognition.object_classes` has its size and its colour; other things say theirs.
    """
    place = [float(value) for value in item["at"]]
    pose = Pose(place[0], place[1], float(item.get("yaw", 0.0)))
    bottom = place[2] if len(place) > 2 else 0.0
    support = supports.get(item.get("support", ""))
    if support is not None:
        pose = support.pose.compose(pose)
        bottom += support.height
    size, radius, height = _shape(item)
    known = OBJECT_CLASSES.get(item["class"])
    color = known.color if known else item.get("color", Solid.color)
    solid = Solid(item["name"], pose, height, size=size, radius=radius, color=color)
    return WorldObject(
        item["class"], solid, bottom, item.get("support"), item.get("tag"), bool(item.get("absent"))
    )


def _shape(item: Dict[str, Any]) -> Tuple[Optional[Tuple[float, float]], Optional[float], float]:
    """Size and radius (one of them None) and height; a height of 0 when it is not given."""
    if "box" in item:
        x, y, height = map(float, item["box"])
        return (x, y), None, height
    if "cylinder" in item:
        radius, height = map(float, item["cylinder"])
        return None, radius, height
    known = OBJECT_CLASSES.get(item["class"])
    return (known.size, known.radius, known.height) if known is not None else (None, 0.0, 0.0)


def find_world(name: str) -> Path:
    """The file of a world given as a path, or as the name of one of this package's worlds."""
    path = Path(name)
    if path.is_file():
        return path
    own = _own_worlds() / (path.name if path.suffix else f"{path.name}.yaml")
    return own if own.exists() and path.parent == Path(".") else path


def _own_worlds() -> Path:
    source = Path(__file__).resolve().parents[3] / "worlds"
    if source.is_dir():
        return source
    import rospkg

    return Path(rospkg.RosPack().get_path("merlin_sim")) / "worlds"
