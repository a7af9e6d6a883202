# SPDX-License-Identifier: Apache-2.0
"""The recognisable objects of a world file: where each stands, and whether it can stand there."""

from typing import Any, Dict, Iterator, List, Optional, Tuple

from merlin_reactive.pose import Pose
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES
from merlin_sim.world.world_model import Solid, World, WorldObject


def read_objects(items: List[Dict[str, Any]], furniture: List[Solid]) -> List[WorldObject]:
    """Makes objects of the list `objects` of a world file that follows the schema.

    With `support`, the place is given in m from the middle of that furniture, along its own axes. A class of
    :mod:`merlin_reactive.recognition.object_classes` has its size and its colour; other things say theirs.
    """
    supports = {solid.name: solid for solid in furniture}
    return [_object(item, supports) for item in items]


def misplaced(world: World) -> Iterator[str]:
    """What is wrong with the places of a world's objects, a sentence each."""
    supports = {solid.name: solid for solid in world.furniture + world.unmapped}
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
        elif thing.support is not None and not _holds(supports[thing.support], pose):
            yield f"objects: {thing.name} stands beside {thing.support}, not on it"
        elif not (left < pose.x < right and bottom < pose.y < top):
            yield f"objects: {thing.name} at ({pose.x:g}, {pose.y:g}) lies outside the walls"
        if thing.bottom < 0.0:
            yield f"objects: {thing.name} stands {-thing.bottom:g} m below the floor"


def _object(item: Dict[str, Any], supports: Dict[str, Solid]) -> WorldObject:
    place = [float(value) for value in item["at"]]
    pose = Pose(place[0], place[1], float(item.get("yaw", 0.0)))
    bottom = place[2] if len(place) > 2 else 0.0
    support = supports.get(item.get("support", ""))
    if support is not None:
        pose = support.pose.compose(pose)
        bottom += support.height
    size, radius, height = _shape(item)
    known = OBJECT_CLASSES.get(item["class"])
    color = known.color if known else item.get("color", "#9a9a9a")
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
    if known is None:
        return None, 0.0, 0.0
    return known.size, known.radius, known.height


def _holds(support: Solid, pose: Pose) -> bool:
    local = support.pose.inverse().compose(pose)
    if support.radius is not None:
        return local.x**2 + local.y**2 <= support.radius**2
    assert support.size is not None
    return abs(local.x) <= support.size[0] / 2 and abs(local.y) <= support.size[1] / 2
