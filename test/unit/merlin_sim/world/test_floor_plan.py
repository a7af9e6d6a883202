# SPDX-License-Identifier: Apache-2.0
"""Random floor plans: every room can be reached, equal seeds give equal plans."""

import pytest

from merlin_reactive.navigation.path_planner import PathPlanner
from merlin_sim.world.floor_plan import FloorPlan, main
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_drawing import main as draw
from merlin_sim.world.world_file import load_world, parse_world


@pytest.mark.parametrize("seed", [1, 2])
def test_every_room_is_reached_from_every_other(seed):
    plan = FloorPlan(5, 10.0, 8.0, seed)
    plan.furnish(2)
    world = parse_world(plan.data())
    assert len(world.points_of_interest) == 5
    assert len(world.doors) == 4
    planner = PathPlanner(map_of(world), 0.25, 0.05)
    first, *others = world.points_of_interest.values()
    for other in others:
        planner.plan(first.point, other.point)


def test_equal_seeds_give_equal_plans(tmp_path):
    files = [tmp_path / name for name in ("a.yaml", "b.yaml", "c.yaml")]
    for file, seed in zip(files, ("7", "7", "8")):
        assert main([str(file), "--rooms", "3", "--size", "9", "7", "--furniture", "1", "--seed", seed]) == 0
    assert files[0].read_text() == files[1].read_text() != files[2].read_text()
    assert load_world(files[0]).name == "floor_7"


def test_a_floor_that_is_too_small(tmp_path, capsys):
    assert main([str(tmp_path / "a.yaml"), "--size", "2", "9"]) == 1
    assert "too small" in capsys.readouterr().err
    for nonsense, words in (
        ("--size=nan", "small"),
        ("--size=inf", "large"),
        ("--rooms=0", "one room, not 0"),
    ):
        more = ["9"] if "size" in nonsense else []
        name, value = nonsense.split("=")
        assert main([str(tmp_path / "a.yaml"), name, value, *more]) == 1
        assert words in capsys.readouterr().err
    assert main([str(tmp_path / "a.yaml"), "--rooms", "50", "--size", "6", "6", "--furniture", "0"]) == 0
    assert "rooms fit" in capsys.readouterr().err


def test_the_file_that_was_written_is_named_and_a_remapped_name_is_none(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["floor", "--rooms", "2", "--furniture", "0"]) == 0
    assert capsys.readouterr().out == "floor: the world floor_1\n"
    with pytest.raises(SystemExit) as ended:
        main(["world:=floor"])
    assert ended.value.code == 2 and "'world:=floor' is a remapping of ROS" in capsys.readouterr().err
    assert draw(["floor", "floor.png"]) == 0
    assert capsys.readouterr().out == "floor.png: the world floor_1\n"
    with pytest.raises(SystemExit):
        draw(["floor", "picture:=floor.png"])
    assert [file.name for file in tmp_path.iterdir() if ":=" in file.name] == []
