# SPDX-License-Identifier: Apache-2.0
"""One of several robots is lost at a moment of what it does, and nothing of the others with it."""

from pathlib import Path

import pytest
from robots import lose_robot
from robots.lose_robot import MOMENTS, Moment, processes_of

MASTER = "http://localhost:11400/"


def process(folder: Path, number: int, namespace: str, *command: str, master: str = MASTER) -> None:
    (folder / str(number)).mkdir()
    environment = f"ROS_MASTER_URI={master}\0ROS_NAMESPACE={namespace}\0"
    (folder / str(number) / "environ").write_text(environment)
    (folder / str(number) / "cmdline").write_text("\0".join(command))


def test_all_processes_of_a_robot_are_found_those_that_start_others_first(tmp_path: Path) -> None:
    process(tmp_path, 1, "/robot_2/", "python3", "navigation", "__name:=navigation")
    process(tmp_path, 2, "/robot_2/", "/bin/sh", "scripts/respawn", "navigation", "__name:=navigation")
    process(tmp_path, 3, "/robot_1/", "python3", "navigation", "__name:=navigation")
    process(tmp_path, 4, "/robot_2/", "python3", "person_voice", "__name:=person_voice")
    process(tmp_path, 5, "/robot_2/", "python3", "x", "__name:=other", master="http://localhost:11500/")
    process(tmp_path, 6, "/robot_2/", "bash")
    (tmp_path / "version").write_text("not a process")
    assert processes_of("robot_2", "http://127.0.0.1:11400", tmp_path) == [
        (2, "navigation"),
        (1, "navigation"),
    ]


def test_a_robot_that_drives_with_an_order_has_loaded_it_and_set_off() -> None:
    moment = Moment("robot_2", MOMENTS["order"])
    moment.see([], ["(robot_at robot_2 table_1)"])
    moment.see(["(carrying robot_1 table_4)"], ["(robot_at robot_1 bar)"])
    moment.see(["(carrying robot_2 table_4)"], [])
    assert not moment.come.is_set()
    moment.see([], ["(robot_at robot_2 bar)"])
    for robot, x in (("robot_2", 1.0), ("robot_1", 9.0), ("robot_2", 2.4)):
        moment.drive(robot, x, 0.0)
        assert not moment.come.is_set()
    moment.drive("robot_2", 2.6, 0.0)
    assert moment.come.is_set()


def test_a_robot_that_talks_is_not_quiet_and_now_is_at_once() -> None:
    talk = Moment("robot_2", MOMENTS["talk"])
    talk.see([], ["(quiet robot_1)"])
    assert not talk.come.is_set()
    talk.see([], ["(quiet robot_2)"])
    assert talk.come.is_set()
    assert Moment("robot_2", MOMENTS["now"]).come.is_set()


def test_nothing_to_kill_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list = []
    monkeypatch.setattr(lose_robot, "processes_of", lambda robot, uri: [])
    assert lose_robot.lose("robot_9", "all", MASTER, reported.append) == 0
    assert reported == ["killed of robot_9: nothing"]
