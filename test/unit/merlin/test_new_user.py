# SPDX-License-Identifier: Apache-2.0
"""What the trial of a second application missed: help, the last recording, a file of points near the test."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from merlin import check, launch_runner
from merlin.new.application import new_application
from merlin.new.package_writer import files_of, write_application
from merlin.replay.command import _arguments
from merlin.testing import simulated_robot
from merlin_test import LONG


@pytest.mark.parametrize(("name", "main"), [("run", launch_runner.main), ("check", check.main)])
@pytest.mark.parametrize("word", ["-h", "--help"])
def test_run_and_check_say_what_they_take(name, main, word, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, word])
    assert main() == 0
    said = capsys.readouterr().out
    assert said.startswith(f"usage: rosrun merlin {name} [package] <launch file> name:=value")


def test_replay_takes_the_recording_of_an_application(monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    assert _arguments([]).bag == tmp_path / "merlin"
    assert _arguments(["other"]).bag == Path("other")


def test_a_file_of_points_is_found_from_the_test_and_from_its_package(monkeypatch, tmp_path):
    package = tmp_path / "src" / "my_robot"
    (package / "test").mkdir(parents=True)
    (package / "worlds").mkdir()
    (package / "worlds" / "my_robot.yaml").write_text(
        "points_of_interest: {hall: {x: 1.0, y: 2.0, yaw: 0.0}}"
    )
    known = {}
    monkeypatch.setattr(simulated_robot.rospy, "set_param", lambda name, value: known.update(value))
    monkeypatch.setattr(simulated_robot, "SERVED", {})
    monkeypatch.setattr(simulated_robot, "ARM", ())
    robot = simulated_robot.SimulatedRobot()
    monkeypatch.chdir(tmp_path)  # as `python -m pytest src/my_robot` in the workspace
    robot.reset(package / "test")
    robot.points("worlds/my_robot.yaml")
    assert known == {"hall": {"x": 1.0, "y": 2.0, "yaw": 0.0}}
    with pytest.raises(FileNotFoundError, match="there is no worlds/other.yaml in"):
        robot.points("worlds/other.yaml")


@pytest.mark.processes
def test_a_test_that_fails_says_why_and_nothing_of_the_master(tmp_path):
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["merlin.testing.fixtures"]\n')
    (tmp_path / "test_it.py").write_text("def test_it(robot):\n    assert robot is None, 'the reason'\n")
    words = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "--rootdir",
        str(tmp_path),
    ]
    done = subprocess.run([*words, tmp_path], capture_output=True, text=True, cwd=tmp_path, timeout=300)
    lines = done.stdout.splitlines()
    assert done.returncode == 1 and any("the reason" in line for line in lines), done.stdout + done.stderr
    assert len(lines) < 60 and not any("rosmaster" in line for line in lines), done.stdout


@pytest.mark.processes
def test_the_tests_of_two_new_packages_run_together(tmp_path):
    packages = [write_application(new_application(name, []), tmp_path / "ws") for name in ("one", "two")]
    path = os.pathsep.join([*(str(package / "src") for package in packages), os.environ["PYTHONPATH"]])
    plan = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--setup-plan"]
    for chosen in (packages[:1], packages):
        done = subprocess.run(
            [*plan, *chosen],
            capture_output=True,
            text=True,
            cwd=tmp_path / "ws",
            timeout=LONG,
            env={**os.environ, "PYTHONPATH": path},
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stdout.count("test_a_cancel_stops_it") == len(chosen)


def test_the_rostest_of_a_new_application_can_answer():
    files = files_of(new_application("my_robot", ["greet ?p - poi"]))
    for name in ("answers", "sees"):
        assert f'<arg name="{name}" default="[]"' in files["launch/my_robot.launch"]
        assert f'<arg name="{name}" value="[]"/>' in files["test/my_robot.test"]
