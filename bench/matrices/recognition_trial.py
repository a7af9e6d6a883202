# SPDX-License-Identifier: Apache-2.0
"""One look at known things in a bare room, without ROS: for the matrix of recognition and for tests."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

import numpy as np
import rospkg

from merlin_reactive.pose import Pose
from merlin_reactive.recognition.camera_view import CameraView
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES, PERSON, PERSON_HEIGHT, TAG
from merlin_reactive.recognition.object_recognizer import ObjectRecognizer
from merlin_reactive.recognition.sighting import Sighting
from merlin_sim.engine.simulation import RobotSpec, Simulation
from merlin_sim.rendering.appearance import GAP
from merlin_sim.rendering.picture_engine import PictureEngine
from merlin_sim.robot.camera import CameraModel
from merlin_sim.world.world_file import parse_world

SAME = 0.25  # m between where a thing is and where it is seen that are one thing
SIGN = 0.16  # m, width and height of what a tag is on
SIGN_BACK = 0.02 + GAP  # m from the middle of it to its card
CORNERS = ((-1.5, -5.0), (7.0, -5.0), (7.0, 5.0), (-1.5, 5.0))


@dataclass(frozen=True)
class Placed:
    """A thing in the room.

    :param kind: a class that can be asked for; a tag as `tag_<number>`.
    :param distance: level, from the middle of the robot, m.
    :param bearing: to the left of straight ahead, rad.
    :param facing: of a tag, away from the robot's line of sight, rad.
    """

    kind: str
    distance: float
    bearing: float
    facing: float = 0.0


@dataclass(frozen=True)
class Look:
    """For each thing that was there its sighting; and what was seen without being there."""

    seen: Dict[Placed, Optional[Sighting]]
    errors: Dict[Placed, float]  # m, of the things that were seen
    false: List[Sighting]


def look(
    things: Sequence[Placed],
    seed: int = 1,
    support: float = 0.75,
    table: bool = True,
    model: Optional[CameraModel] = None,
    recognizer: Optional[ObjectRecognizer] = None,
) -> Look:
    """Takes one picture from the origin along x and recognises everything in it.

    :param support: height of the wide table that objects stand on, m.
    :param table: whether it is there; without it objects hang in the air.
    """
    model = model or CameraModel()
    world = parse_world(_room(things, support, table))
    urdf = Path(rospkg.RosPack().get_path("merlin_sim")) / "urdf" / "rb1.urdf"
    simulation = Simulation(world, [RobotSpec("", Pose(0.0, 0.0), camera=model)], urdf, seed)
    pictures = PictureEngine()
    try:
        robot = simulation.robots[""]
        for _ in range(5):
            simulation.step()
        pose = robot.body.camera_pose()
        assert pose is not None
        picture = pictures.expose(simulation.shot(robot))
    finally:
        simulation.close()
        pictures.close()
    view = CameraView(model.matrix(), pose.optical(), model.width, model.height)
    return _compare(things, support, (recognizer or ObjectRecognizer()).recognize(picture, view))


def truth(thing: Placed, support: float = 0.75) -> np.ndarray:
    """Where the middle of a thing is, m."""
    x, y = thing.distance * math.cos(thing.bearing), thing.distance * math.sin(thing.bearing)
    if thing.kind == PERSON:
        return np.array([x, y, PERSON_HEIGHT / 2])
    if thing.kind in OBJECT_CLASSES:
        return np.array([x, y, support + OBJECT_CLASSES[thing.kind].height / 2])
    return np.array([x, y, support + SIGN / 2])


def _compare(things: Sequence[Placed], support: float, sightings: List[Sighting]) -> Look:
    seen: Dict[Placed, Optional[Sighting]] = {}
    errors = {}
    left = list(sightings)
    for thing in things:
        places = _cards(thing, support) if thing.kind.startswith(f"{TAG}_") else [truth(thing, support)]
        offsets = {
            index: min(float(np.linalg.norm(np.array(sighting.position) - place)) for place in places)
            for index, sighting in enumerate(left)
            if sighting.name == thing.kind
        }
        nearest = min(offsets, key=lambda index: offsets[index], default=None)
        if nearest is None or offsets[nearest] > SAME:
            seen[thing] = None
            continue
        errors[thing] = offsets[nearest]
        seen[thing] = left.pop(nearest)
    return Look(seen, errors, left)


def _cards(thing: Placed, support: float) -> List[np.ndarray]:
    """The middles of a sign's four cards."""
    x, y, z = truth(thing, support)
    yaw = thing.bearing + math.pi + thing.facing
    ahead = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    left = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    front = np.array([x, y, z])
    middle = front - SIGN_BACK * ahead
    side = SIGN / 2 + GAP
    return [front, middle - SIGN_BACK * ahead, middle + side * left, middle - side * left]


def _room(things: Sequence[Placed], support: float, table: bool) -> Dict[str, Any]:
    top = {"name": "table", "at": [2.45, 0.0], "box": [3.9, 6.0, support], "color": "#a67c52"}
    people = [thing for thing in things if thing.kind == PERSON]
    return {
        "name": "room",
        "wall": {"height": 2.6},
        "walls": [{"from": list(CORNERS[i]), "to": list(CORNERS[(i + 1) % 4])} for i in range(4)],
        "furniture": [top] if table else [],
        "points_of_interest": {},
        "starts": [],
        "people": [
            {"name": f"person_{index}", "path": [truth(thing)[:2].tolist()]}
            for index, thing in enumerate(people)
        ],
        "objects": [
            _item(f"thing_{index}", thing, support)
            for index, thing in enumerate(things)
            if thing.kind != PERSON
        ],
    }


def _item(name: str, thing: Placed, support: float) -> Dict[str, Any]:
    x, y, _ = truth(thing, support).tolist()
    if thing.kind in OBJECT_CLASSES:
        return {"name": name, "class": thing.kind, "at": [x, y, support], "yaw": thing.facing}
    # A sign behind the middle of its card.
    yaw = thing.bearing + math.pi + thing.facing
    x, y = x - SIGN_BACK * math.cos(yaw), y - SIGN_BACK * math.sin(yaw)
    number = int(thing.kind[len(TAG) + 1 :])
    return {
        "name": name,
        "class": "sign",
        "at": [x, y, support],
        "yaw": yaw,
        "box": [2 * (SIGN_BACK - GAP), SIGN, SIGN],
        "tag": number,
    }
