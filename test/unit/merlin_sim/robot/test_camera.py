# SPDX-License-Identifier: Apache-2.0
"""The camera: what stands somewhere appears where its geometry says, and looks like its class."""

import colorsys
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from merlin_reactive.pose import Pose
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES
from merlin_reactive.recognition.tags import TAG, tag_dictionary
from merlin_sim.engine.simulation import RobotSpec, Simulation
from merlin_sim.rendering.appearance import GAP
from merlin_sim.rendering.picture_engine import PictureEngine
from merlin_sim.robot.camera import CameraModel
from merlin_sim.world.world_file import parse_world

URDF = Path(__file__).resolve().parents[4] / "src" / "merlin_sim" / "urdf" / "rb1.urdf"
CORNERS = [[-1, -3], [5, -3], [5, 3], [-1, 3]]
START = Pose(0.0, 0.0)
SMALL = CameraModel(width=320, height=240, noise=0.0)


def look(*objects, people=(), model=SMALL, start=START, seed=1, steps=2):
    """The picture of a robot in a room with a table ahead, and the projection of points of the map to it."""
    world = parse_world(
        {
            "name": "room",
            "walls": [{"from": CORNERS[i], "to": CORNERS[(i + 1) % 4]} for i in range(4)],
            "furniture": [{"name": "table", "at": [1.6, 0], "box": [0.8, 1.6, 0.75], "color": "#a67c52"}],
            "points_of_interest": {},
            "starts": [],
            "objects": [{"name": f"thing_{i}", "support": "table", **item} for i, item in enumerate(objects)],
            "people": [{"name": f"person_{i}", "path": [place]} for i, place in enumerate(people)],
        }
    )
    simulation = Simulation(world, [RobotSpec("", start, camera=model)], URDF, seed)
    try:
        for _ in range(steps):
            simulation.step()
        robot = simulation.robots[""]
        to_optical = np.linalg.inv(robot.body.camera_pose().optical())
        picture = PictureEngine().expose(simulation.shot(robot))
    finally:
        simulation.close()

    def pixel(x, y, z):
        u, v, w = model.matrix() @ (to_optical @ [x, y, z, 1.0])[:3]
        return round(u / w), round(v / w)

    return picture, pixel


def hue_at(picture, place):
    red, green, blue = picture[place[1], place[0]] / 255
    return 360 * colorsys.rgb_to_hsv(red, green, blue)[0]


@pytest.mark.parametrize("kind", sorted(OBJECT_CLASSES))
def test_a_thing_appears_where_it_stands_in_the_colour_of_its_class(kind):
    known = OBJECT_CLASSES[kind]
    picture, pixel = look({"class": kind, "at": [0.1, 0.3]})
    # A quarter up its front, which faces the robot, or near the rim of what is flat: nothing dark there.
    depth, rise = known.radius or known.size[0] / 2, known.height / 4
    if known.height < 0.03:
        depth, rise = 0.85 * depth, known.height
    color = [int(known.color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    hue = hue_at(picture, pixel(1.7 - depth, 0.3, 0.75 + rise))
    assert math.remainder(hue - 360 * colorsys.rgb_to_hsv(*color)[0], 360) == pytest.approx(0, abs=6)


def test_a_full_cup_is_dark_on_top_and_an_empty_one_is_not():
    picture, pixel = look({"class": "coffee", "at": [0, 0.3]}, {"class": "cup", "at": [0, -0.3]})
    full, empty = pixel(1.56, 0.3, 0.75 + 0.085), pixel(1.56, -0.3, 0.75 + 0.085)
    assert picture[full[1], full[0]].max() < 40 < 120 < picture[empty[1], empty[0]].max()


def test_a_person_has_clothes_and_a_head():
    picture, pixel = look(people=[[3.5, 0.5]])
    assert hue_at(picture, pixel(3.3, 0.5, 1.2)) == pytest.approx(332, abs=6)
    assert hue_at(picture, pixel(3.4, 0.5, 1.57)) == pytest.approx(27, abs=6)


def test_turning_left_moves_things_to_the_right():
    _, pixel = look()
    assert pixel(3.0, 0.0, 1.0)[0] == pytest.approx(SMALL.width / 2, abs=2)
    _, turned = look(start=Pose(0.0, 0.0, 0.2))
    assert turned(3.0, 0.0, 1.0)[0] > SMALL.width / 2 + 30


def test_noise_depends_on_seed_and_time_only():
    model = CameraModel(width=64, height=48, noise=4.0)
    one, again, other, later = (
        look(model=model, seed=seed, steps=steps)[0] for seed, steps in ((1, 2), (1, 2), (2, 2), (1, 3))
    )
    assert (one == again).all()
    assert (one != other).any()
    assert (one != later).any()


def test_a_tag_can_be_read_from_the_side_that_it_faces():
    thing = {"class": "sign", "at": [0, 0.2], "box": [0.16, 0.04, 0.16], "tag": 7}
    picture, pixel = look(thing, model=CameraModel())
    corners, numbers, _ = cv2.aruco.detectMarkers(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), tag_dictionary())
    assert numbers.ravel().tolist() == [7]
    # First corner: the upper left one, as seen from in front of the tag.
    side = 1.6 - 0.08 - GAP
    expected = [
        pixel(side, 0.2 + y * TAG / 2, 0.83 + z * TAG / 2) for y, z in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    assert corners[0][0] == pytest.approx(np.array(expected), abs=2)
