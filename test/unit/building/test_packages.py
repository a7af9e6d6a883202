# SPDX-License-Identifier: Apache-2.0
"""Packages: those of a profile, without those of another ROS 1; apt-get reaches the network."""

import importlib.metadata
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import List

import pytest

pytestmark = pytest.mark.everywhere

ROOT = Path(__file__).resolve().parents[3]
OF_ROS = {"catkin", "ros-core", "python3-rospy", "ros-std-msgs", "libnav-msgs-dev", "tf2-tools"}
OTHERS = {"build-essential", "python3-opencv", "graphviz", "catkin-lint"}


def ask(opt_ros: Path, *words: str, **variables: str) -> List[str]:
    env = {"PATH": os.environ["PATH"], "OPT_ROS": str(opt_ros), **variables}
    command = [str(ROOT / "tools" / "packages.sh"), *(words or ["apt.txt"])]
    return subprocess.run(command, env=env, check=True, capture_output=True, text=True).stdout.split()


def ros(prefix: Path) -> Path:
    """A prefix with a whole ROS."""
    (prefix / "share" / "rospy").mkdir(parents=True)
    (prefix / "share" / "rospy" / "package.xml").touch()
    return prefix


def test_with_debians_ros_every_package_is_wanted(tmp_path: Path) -> None:
    wanted = set(ask(tmp_path))
    assert wanted >= OF_ROS | OTHERS
    assert ask(tmp_path, "--ros") == []


@pytest.mark.parametrize("place", ["opt", "CMAKE_PREFIX_PATH", "CONDA_PREFIX"])
def test_with_another_ros_its_packages_are_left_out(place: str, tmp_path: Path) -> None:
    prefix = ros(tmp_path / "ros" / "one")
    overlay = tmp_path / "overlay" / "devel"
    opt = prefix.parent if place == "opt" else tmp_path / "empty"
    path = f"{overlay}:{prefix}" if place == "CMAKE_PREFIX_PATH" else str(prefix)
    variables = {} if place == "opt" else {place: path}
    assert ask(opt, "--ros", **variables) == [str(prefix)]
    wanted = set(ask(opt, **variables))
    assert wanted >= OTHERS and not wanted & OF_ROS


def test_an_overlay_on_debians_ros_leaves_nothing_out(tmp_path: Path) -> None:
    (tmp_path / "devel" / "share" / "my_package").mkdir(parents=True)
    assert ask(tmp_path / "opt", "--ros", CMAKE_PREFIX_PATH=f"{tmp_path}/devel:/usr") == []


def test_a_user_with_sudo_keeps_the_proxy(tmp_path: Path) -> None:
    tools, programs = tmp_path / "tools", tmp_path / "programs"
    for folder in (tools, programs):
        folder.mkdir()
    shutil.copy(str(ROOT / "tools" / "build.sh"), str(tools))
    scripts = {
        tools / "packages.sh": "case $1 in --ros) ;; --largest) echo robot ;; *) echo a-package ;; esac",
        programs / "dpkg-query": "true",
        programs / "id": "echo 1000",
        programs / "sudo": 'echo "sudo $*"; false',
    }
    for path, text in scripts.items():
        path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
        path.chmod(0o755)
    env = {"PATH": f"{programs}:{os.environ['PATH']}", "http_proxy": "http://proxy:3128"}
    done = subprocess.run([str(tools / "build.sh")], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "could not install" in done.stderr
    asked = (tmp_path / ".apt.log").read_text(encoding="utf-8").splitlines()
    assert "http_proxy=http://proxy:3128 apt-get install" in asked[-1]
    assert "https_proxy" not in asked[-1]
    assert "DPkg::Lock::Timeout=" in asked[-1], "another apt-get is waited for"


NOT_ON_A_ROBOT = (
    r"pybullet|panda3d|etcd|grpc|chromium|playwright|pytest|hypothesis|ruff|mypy|matplotlib|scipy|lint|fonts"
)
LISTS = ("apt.txt", "requirements.txt", "requirements-nodeps.txt")


def profile(name: str, tmp_path: Path) -> List[str]:
    return [line for file in LISTS for line in ask(tmp_path, file, name)]


def test_profiles_contain_each_other(tmp_path: Path) -> None:
    robot, simulation, everything = (set(profile(name, tmp_path)) for name in ("robot", "simulation", "all"))
    assert robot < simulation < everything
    assert {"python3-rospy", "rdflib==7.6.0"} <= robot
    assert {"panda3d==1.10.16", "python3-matplotlib"} <= simulation - robot


def test_a_robot_gets_neither_simulator_nor_fleet_nor_tests(tmp_path: Path) -> None:
    assert [line for line in profile("robot", tmp_path) if re.search(NOT_ON_A_ROBOT, line)] == []
    left_out = set(ask(tmp_path, "--left-out", "robot"))
    assert left_out > set(ask(tmp_path, "--left-out", "simulation"))
    assert left_out >= {"merlin_sim", "merlin_test"} and not ask(tmp_path, "--left-out", "all")


@pytest.mark.parametrize("name", ["robot", "simulation"])
def test_a_fleet_is_added_when_asked_for(name: str, tmp_path: Path) -> None:
    plain, fleet = (profile(asked, tmp_path) for asked in (name, f"{name}+fleet"))
    assert set(fleet) - set(plain) == {"python3-grpcio", "python3-protobuf", "openssl"}
    assert set(fleet) < set(profile("all", tmp_path))
    assert ask(tmp_path, "--left-out", f"{name}+fleet") == ask(tmp_path, "--left-out", name)
    assert [ask(tmp_path, "--extras", asked) for asked in (name, f"{name}+fleet", "all")] == [
        [],
        ["yes"],
        ["yes"],
    ]


def test_without_the_fleet_its_launch_file_says_how_to_build_it() -> None:
    code = "from merlin.launch_request import declared_arguments; declared_arguments({!r})"
    command = [sys.executable, "-c", code.format(str(ROOT / "launch" / "fleet.launch"))]
    env = {**os.environ, "ROS_PACKAGE_PATH": str(ROOT / "src" / "merlin")}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    said = done.stderr.splitlines()[-1]
    assert "LaunchError" in said and "make build PROFILE=robot+fleet" in said


@pytest.mark.parametrize("name", ["robot", "simulation"])
def test_nothing_that_is_built_imports_what_is_left_out(name: str, tmp_path: Path) -> None:
    left_out = [*ask(tmp_path, "--left-out", name), *(path.name for path in (ROOT / "extras").iterdir())]
    modules = rf"^\s*(?:from|import) ({'|'.join(left_out)})\b"
    for package in (ROOT / "src").glob("merlin*"):
        if package.name not in left_out and package.name != "merlin_test":
            for file in (package / "src").rglob("*.py"):
                assert not re.search(modules, file.read_text(encoding="utf-8"), re.MULTILINE), file


def test_the_largest_profile_is_taken(tmp_path: Path) -> None:
    assert ask(tmp_path, "--largest", "robot", "simulation", "robot") == ["simulation"]
    assert ask(tmp_path, "--largest", "all", "robot+fleet") == ["all"]
    assert ask(tmp_path, "--largest", "robot+fleet", "simulation") == ["simulation+fleet"]


@pytest.mark.skipif(importlib.util.find_spec("pyrobosim") is None, reason="pyrobosim is not installed")
def test_what_pyrobosim_imports_is_installed_with_it(tmp_path: Path) -> None:
    needs = {re.split(r"[^\w-]", each)[0].lower() for each in importlib.metadata.requires("pyrobosim") or ()}
    given = {word.split("==")[0] for word in profile("robot+deliberation", tmp_path)}
    # Its page is not started, and Debian has the others.
    assert needs - given == {"dash", "numpy", "pillow", "pyyaml", "scipy"}


def test_pyrobosim_is_added_when_asked_for_only(tmp_path: Path) -> None:
    for name in ("robot", "simulation+fleet", "all"):
        assert "pyrobosim==5.0.1;" not in profile(name, tmp_path)
        assert "pyrobosim==5.0.1;" in profile(f"{name}+deliberation", tmp_path)
    asked = ("robot", "robot+deliberation", "all")
    assert [ask(tmp_path, "--examples", each) for each in asked] == [[], ["yes"], ["yes"]]
    assert ask(tmp_path, "--largest", "robot+deliberation", "all") == ["all+deliberation"]
    both = ask(tmp_path, "--largest", "robot+fleet", "simulation+deliberation")
    assert both == ["simulation+fleet+deliberation"]
