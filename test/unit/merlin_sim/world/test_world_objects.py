# SPDX-License-Identifier: Apache-2.0
"""Objects of world files: where they stand, and what is said about impossible ones."""

import math
from pathlib import Path

import pytest

from merlin_sim.world.world_file import WorldError, load_world, parse_world

WORLDS = Path(__file__).resolve().parents[4] / "src" / "merlin_sim" / "worlds"
CORNERS = [[0, 0], [4, 0], [4, 3], [0, 3]]
CUP = {"name": "red_cup", "class": "cup", "at": [1, 1], "cylinder": [0.04, 0.1], "color": "#d01818"}


def room(*objects):
    return {
        "name": "room",
        "walls": [{"from": CORNERS[i], "to": CORNERS[(i + 1) % 4]} for i in range(4)],
        "furniture": [{"name": "table", "at": [3, 2, math.pi / 2], "box": [1, 0.5, 0.7]}],
        "points_of_interest": {},
        "starts": [],
        "objects": list(objects),
    }


def test_an_object_on_turned_furniture_stands_on_its_top_along_its_axes():
    cup = parse_world(room({**CUP, "support": "table", "at": [0.4, 0.1], "tag": 7})).objects[0]
    assert (cup.name, cup.kind, cup.tag, cup.support) == ("red_cup", "cup", 7, "table")
    assert (cup.solid.pose.x, cup.solid.pose.y, cup.bottom) == pytest.approx((2.9, 2.4, 0.7))


def test_an_object_may_stand_at_a_height_of_its_own():
    cup = parse_world(room({**CUP, "at": [1, 2, 0.5], "yaw": 0.3})).objects[0]
    assert (cup.solid.pose.x, cup.solid.pose.y, cup.solid.pose.yaw, cup.bottom) == (1, 2, 0.3, 0.5)


def test_a_known_class_brings_its_size_and_colour():
    thing = parse_world(room({"name": "c", "class": "coffee", "support": "table", "at": [0, 0]})).objects[0]
    assert (thing.solid.radius, thing.solid.height, thing.solid.color) == (0.04, 0.10, "#d01818")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"support": "shelf"}, "red_cup stands on shelf, which is not furniture"),
        ({"support": "table", "at": [0.6, 0]}, "red_cup stands beside table"),
        ({"at": [5, 1]}, "outside the walls"),
        ({"at": [1, 1, -0.2]}, "0.2 m below the floor"),
        ({"tag": 50}, "objects[0].tag"),
        ({"class": "Red cup"}, "objects[0].class"),
        ({"box": [1, 1, 1]}, "objects[0]"),
        ({"cylinder": None, "class": "hat"}, "red_cup needs box or cylinder; its class hat has no size"),
        ({"name": "table"}, "the name table is used twice"),
    ],
)
def test_impossible_objects_are_refused_with_the_place(changes, words):
    with pytest.raises(WorldError) as error:
        changed = {**CUP, **changes}
        parse_world(room({key: value for key, value in changed.items() if value is not None}))
    assert words in str(error.value)


@pytest.mark.parametrize("name", ["apartment", "restaurant"])
def test_the_worlds_have_objects(name):
    assert load_world(WORLDS / f"{name}.yaml").objects
