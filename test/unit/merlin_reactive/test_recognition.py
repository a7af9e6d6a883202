# SPDX-License-Identifier: Apache-2.0
"""Recognition without ROS: what stands where in rendered pictures, and in pictures of nothing."""

import math
from pathlib import Path

import numpy as np
import pytest
import rospkg
from matrices.recognition_trial import Placed, look

from merlin_reactive.recognition.camera_view import CameraView, overlap
from merlin_reactive.recognition.object_classes import OBJECT_CLASSES, PERSON, unknown_classes
from merlin_reactive.recognition.object_recognizer import ObjectRecognizer, annotated
from merlin_reactive.recognition.sighting import Sighting, merge
from merlin_sim.engine.simulation import RobotSpec, Simulation
from merlin_sim.engine.world_control import Placing
from merlin_sim.rendering.picture_engine import PictureEngine
from merlin_sim.robot.camera import CameraModel, CameraPose
from merlin_sim.world.world_file import load_world

MODEL = CameraModel()
HERE = CameraView(MODEL.matrix(), CameraPose(np.array([0, 0, 1.4]), np.eye(3)).optical(), 640, 480)
BEARINGS = [math.radians(angle) for angle in (-25, -8, 8, 25)]


def side_by_side(kinds, distance):
    return [Placed(kind, distance, bearing) for kind, bearing in zip(kinds, BEARINGS)]


def groups():
    kinds = sorted(OBJECT_CLASSES)
    return [kinds[first : first + 4] for first in range(0, len(kinds), 4)]


@pytest.mark.parametrize(("support", "distance"), [(0.75, 0.9), (0.75, 2.4), (1.1, 1.3), (1.1, 2.5)])
@pytest.mark.parametrize("kinds", groups(), ids=",".join)
def test_every_class_is_told_apart_and_placed(kinds, support, distance):
    done = look(side_by_side(kinds, distance), support=support)
    assert {thing.kind: bool(seen) for thing, seen in done.seen.items()} == dict.fromkeys(kinds, True)
    assert done.false == []
    assert max(done.errors.values()) < 0.06
    assert all(0.5 <= seen.score <= 1.0 and seen.depth_from == "support" for seen in done.seen.values())


def test_people_and_tags_are_found():
    things = [
        Placed("person", 2.5, BEARINGS[1]),
        Placed("person", 2.5, BEARINGS[3]),
        Placed("tag_7", 1.2, 0.0),
    ]
    done = look(things)
    assert all(done.seen.values())
    assert done.false == []
    assert max(done.errors.values()) < 0.08
    # The card looks back at the robot: its z axis is the map's -x.
    x, y, z, w = done.seen[things[2]].turn
    assert (2 * (x * z + y * w), 2 * (y * z - x * w)) == pytest.approx((-1, 0), abs=0.15)


def test_two_cups_beside_a_plate_are_two():
    things = [Placed("cup", 1.5, -0.15), Placed("cup", 1.5, 0.15), Placed("plate", 1.5, 0.0)]
    done = look(things)
    assert all(done.seen.values())
    assert done.false == []


@pytest.mark.parametrize(
    "things",
    [
        [("cup", 1.5, 0.027), ("cup", 1.5, -0.027)],  # they touch
        [("water", 1.5, 0.0), ("water", 1.7, 0.033)],  # half hidden
        [("cup", 1.4, 0.0), ("cup", 1.52, 0.0)],  # one behind the other
        [("bottle", 1.2, 0.02), ("plate", 1.4, 0.0)],
    ],
    ids=str,
)
def test_things_that_hide_a_part_of_each_other_are_two(things):
    done = look([Placed(*thing) for thing in things])
    assert all(done.seen.values())
    assert done.false == []
    assert max(done.errors.values()) < 0.05


def test_what_stands_at_no_known_height_is_placed_by_its_size():
    things = side_by_side(["bottle", "cake"], 1.2)
    done = look(things, support=1.0, table=False)
    assert all(seen and seen.depth_from == "size" for seen in done.seen.values())
    assert max(done.errors.values()) < 0.15
    known = look(things, support=1.0, table=False, recognizer=ObjectRecognizer(supports=[1.0]))
    assert max(known.errors.values()) < 0.03


def test_one_thing_a_little_above_a_known_height_is_not_two():
    recognizer = Remembering()
    look(
        [Placed("water", 1.79, 0.36), Placed("water", 1.7, 0.02)],
        support=0.82,
        table=False,
        recognizer=recognizer,
    )
    seen = recognizer.recognize(recognizer.picture, recognizer.view)
    assert [sighting.name for sighting in seen] == ["water", "water"]


class Remembering(ObjectRecognizer):
    """Keeps the last picture."""

    def recognize(self, picture, view, *args, **more):
        self.picture, self.view = picture, view
        return super().recognize(picture, view, *args, **more)


@pytest.fixture(scope="module")
def remembered():
    recognizer = Remembering()
    look(side_by_side(["cup", "coffee", "tag_3"], 1.2), recognizer=recognizer)
    return recognizer


def test_only_what_is_asked_for_is_reported(remembered):
    def names(*classes):
        seen = remembered.recognize(remembered.picture, remembered.view, classes)
        return sorted(sighting.name for sighting in seen)

    assert names() == ["coffee", "cup", "tag_3"]
    assert names("cup") == ["cup"]  # and not the coffee, which is as red
    assert names("tag", "coffee") == ["coffee", "tag_3"]
    assert names("tag_3") == ["tag_3"]
    assert names("tag_4", "plate") == []


@pytest.mark.parametrize("name", ["teapot", "tag_50", "tag_07", "tag_²", "tag_x", "Cup", ""])
def test_unknown_classes_are_refused_and_the_known_ones_named(name):
    said = unknown_classes(["cup", name])
    assert said.startswith(f"unknown class {name!r}; known: cup, coffee")


def test_poses_follow_the_camera(remembered):
    before = {s.name: s.position for s in remembered.recognize(remembered.picture, remembered.view)}
    turned = np.array(
        [[0.0, -1, 0, 3], [1, 0, 0, 4], [0, 0, 1, 0], [0, 0, 0, 1]]
    )  # 90° to the left, and away
    view = CameraView(remembered.view.matrix, turned @ remembered.view.optical, 640, 480)
    for sighting in remembered.recognize(remembered.picture, view):
        x, y, z = before[sighting.name]
        assert sighting.position == pytest.approx((3 - y, 4 + x, z), abs=1e-6)


def test_a_look_can_be_stopped(remembered):
    assert remembered.recognize(remembered.picture, remembered.view, stop=lambda: True) == []


def test_the_drawing_leaves_the_picture_as_it_is(remembered):
    before = remembered.picture.copy()
    seen = remembered.recognize(remembered.picture, remembered.view)
    drawn = annotated(remembered.picture, seen)
    assert (remembered.picture == before).all()
    left, top, right, _ = (round(edge) for edge in seen[0].box)
    assert (drawn[top, left:right] != before[top, left:right]).any(axis=1).all()


@pytest.mark.parametrize("seed", range(3))
def test_in_noise_and_in_the_dark_is_nothing(seed):
    noise = np.random.default_rng(seed).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    assert ObjectRecognizer().recognize(noise, HERE) == []
    assert ObjectRecognizer().recognize(noise // 200, HERE) == []


def test_of_two_sightings_of_one_thing_the_better_one_stays():
    def cup(score, x):
        return Sighting("cup", score, (x, 0.0, 0.8), (0.08, 0.08, 0.1), (0, 0, 1, 1))

    assert [s.score for s in merge([cup(0.6, 1.0), cup(0.9, 1.03), cup(0.7, 1.2)])] == [0.9, 0.7]


def test_overlap():
    assert overlap((0, 0, 2, 2), (1, 0, 3, 2)) == pytest.approx(1 / 3)
    assert overlap((0, 0, 1, 1), (2, 0, 3, 1)) == 0.0
    assert overlap(None, (0, 0, 1, 1)) == 0.0


@pytest.mark.parametrize("bearing", range(28, 38))
def test_a_person_whom_the_edge_of_the_picture_cuts_is_not_seen_elsewhere(bearing):
    assert look([Placed("person", 2.0, math.radians(bearing))]).false == []


def test_a_guest_who_sits_behind_a_table_is_a_person_at_that_place():
    package = Path(rospkg.RosPack().get_path("merlin_sim"))
    world = load_world(package / "worlds" / "restaurant.yaml")
    model, seat = CameraModel(), world.furniture + world.unmapped
    chair = next(solid for solid in seat if solid.name == "chair_3").pose
    spec = RobotSpec("", world.points_of_interest["table_3"], camera=model)
    simulation = Simulation(world, [spec], package / "urdf" / "rb1.urdf", 1)
    try:
        simulation.control.place(Placing("guest", kind="person", pose=chair, sit=True))
        simulation.step()
        pose = simulation.robots[""].body.camera_pose()
        picture = PictureEngine().expose(simulation.shot(simulation.robots[""]))
    finally:
        simulation.close()
    view = CameraView(model.matrix(), pose.optical(), model.width, model.height)
    found = [sighting for sighting in ObjectRecognizer().recognize(picture, view) if sighting.name == PERSON]
    assert [math.dist(sighting.position[:2], chair.point) < 0.05 for sighting in found] == [True]
    assert found[0].score > 0.8
