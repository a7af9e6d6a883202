# SPDX-License-Identifier: Apache-2.0
"""Reading world files, and what is said about bad ones."""

import copy
import math
from pathlib import Path

import pytest
import yaml

from merlin_reactive.pose import Pose
from merlin_sim.world.world_file import WorldError, load_world, parse_world
from merlin_sim.world.world_model import DoorEvent, MoveEvent

WORLDS = Path(__file__).resolve().parents[4] / "src" / "merlin_sim" / "worlds"
GOOD = {
    "name": "room",
    "walls": [
        {"from": [0, 0], "to": [4, 0]},
        {"from": [4, 0], "to": [4, 3]},
        {"from": [4, 3], "to": [0, 3]},
        {"from": [0, 3], "to": [0, 0]},
    ],
    "doors": [{"name": "exit", "from": [1, 0], "to": [2, 0], "open": False}],
    "furniture": [{"name": "table", "at": [3, 2, 0.5], "box": [1, 0.5, 0.7]}],
    "people": [{"name": "ann", "path": [[1, 1], [3, 1]], "speed": 0.5}],
    "events": [{"at": 9, "door": "exit", "open": True}, {"at": 3, "move": "table", "to": [2, 2]}],
    "points_of_interest": {"middle": {"x": 2, "y": 1.5}},
    "starts": [{"x": 1, "y": 1, "yaw": 1.57}],
}


SELF = []
SELF.append(SELF)


def changed(**fields):
    data = copy.deepcopy(GOOD)
    data.update(fields)
    return data


def test_a_world_holds_what_its_file_says():
    world = parse_world(GOOD)
    assert world.points_of_interest == {"middle": Pose(2.0, 1.5, 0.0)}
    assert world.starts == [Pose(1.0, 1.0, 1.57)]
    assert world.events == [MoveEvent(3.0, "table", Pose(2.0, 2.0)), DoorEvent(9.0, "exit", True)]
    assert world.people[0].path == ((1.0, 1.0), (3.0, 1.0))
    assert world.bounds() == (0, 0, 4, 3)


def test_doors_are_openings_of_their_own_width():
    pieces = [solid for solid in parse_world(GOOD).wall_solids() if solid.name.startswith("wall_0")]
    ends = sorted(x for piece in pieces for x, y in piece.corners())
    assert ends[0] == pytest.approx(-0.05)
    assert any(math.isclose(x, 1.0) for x in ends) and any(math.isclose(x, 2.0) for x in ends)
    assert not any(1.01 < x < 1.99 for x in ends)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ([], ["the file", "object"]),
        ({k: v for k, v in GOOD.items() if k != "starts"}, ["'starts' is a required property"]),
        (changed(gravity=1), ["'gravity'"]),
        (changed(walls=[{"from": [0, 0], "to": [4]}]), ["walls[0].to"]),
        (changed(walls=[{"from": [1, 1], "to": [1, 1]}]), ["walls[0]", "no length"]),
        (changed(points_of_interest={"Bad Name": {"x": 1, "y": 1}}), ["points_of_interest", "Bad Name"]),
        (changed(points_of_interest={"far": {"x": 9, "y": 1}}), ["points_of_interest.far", "outside"]),
        (changed(doors=[{"name": "d", "from": [1, 1], "to": [2, 1]}]), ["d lies in no wall"]),
        (changed(furniture=[*GOOD["furniture"], *GOOD["furniture"]]), ["table is used twice"]),
        (changed(furniture=[{"name": "t", "at": [1, 1]}]), ["furniture[0]"]),
        (changed(doors=[{"name": "d", "from": [1, 0], "to": [1, 0], "open": False}]), ["d has no width"]),
        (changed(furniture=[{"name": "wall_0_0", "at": [1, 1], "box": [1, 1, 1]}]), ["wall_0_0", "own"]),
        (changed(people=[{"name": "robot", "path": [[1, 1]]}]), ["robot", "own"]),
        (changed(people=[{"name": "ann", "path": [[1, 1], [9, 1]]}]), ["people.ann", "(9, 1)", "outside"]),
        (changed(events=[{"at": 1, "move": "table", "to": [2, -1]}]), ["events", "table", "outside"]),
        (changed(resolution=10**400), ["resolution", "not a finite number"]),
        (changed(walls=SELF), ["contains itself"]),
        (changed(events=[{"at": 1, "door": "gate", "open": True}]), ["no door gate"]),
        (changed(events=[{"at": -1, "door": "exit", "open": True}]), ["events[0]"]),
        (changed(people=[{"name": "ann", "path": []}]), ["people[0].path"]),
        (changed(starts=[{"x": math.nan, "y": 1}]), ["starts[0].x", "nan", "not a finite number"]),
        (changed(wall={"thickness": math.inf}), ["wall.thickness", "inf"]),
        (changed(points_of_interest={True: {"x": 1, "y": 1}}), ["points_of_interest", "True", "quotes"]),
        (changed(walls=[{"from": [0, 0], "to": [1e9, 1e9]}]), ["walls", "too large"]),
        (changed(starts=[{"x": 2.9, "y": 1.6}]), ["starts[0]", "(2.9, 1.6)", "taken by table"]),
        (changed(starts=[{"x": 0.2, "y": 1.6}]), ["starts[0]", "in a wall"]),
        (changed(points_of_interest={"desk": {"x": 3, "y": 2}}), ["points_of_interest.desk", "table"]),
    ],
)
def test_what_is_wrong_is_said_with_its_place(data, words):
    with pytest.raises(WorldError) as error:
        parse_world(data, "room.yaml")
    assert "room.yaml" in str(error.value)
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(WorldError, match="No such file"):
        load_world(tmp_path / "nowhere.yaml")
    broken = tmp_path / "broken.yaml"
    broken.write_text("name: [room\nwalls: 3")
    with pytest.raises(WorldError, match=r"line 2.*not YAML"):
        load_world(broken)
    broken.write_text("[" * 5000)
    with pytest.raises(WorldError, match="nested too deeply"):
        load_world(broken)
    broken.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(WorldError, match="not UTF-8"):
        load_world(broken)


def test_every_world_that_comes_with_the_package_can_be_loaded():
    files = sorted(WORLDS.glob("*.yaml"))
    assert files
    for file in files:
        assert load_world(file).name == file.stem


def test_a_world_survives_being_written_and_read(tmp_path):
    file = tmp_path / "room.yaml"
    file.write_text(yaml.safe_dump(GOOD))
    assert load_world(file) == parse_world(GOOD)
