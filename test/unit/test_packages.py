"""Debian packages: those of another ROS 1 are left out; apt-get reaches the network."""

import os
import shutil
import subprocess
from pathlib import Path
from typing import List

import pytest

pytestmark = pytest.mark.everywhere

ROOT = Path(__file__).resolve().parents[2]
OF_ROS = {"catkin", "ros-core", "python3-rospy", "ros-std-msgs", "libnav-msgs-dev", "tf2-tools"}
OTHERS = {"build-essential", "python3-opencv", "graphviz", "catkin-lint"}


def ask(opt_ros: Path, *words: str, **variables: str) -> List[str]:
    env = {"PATH": os.environ["PATH"], "OPT_ROS": str(opt_ros), **variables}
    command = [str(ROOT / "tools" / "apt_packages.sh"), *words]
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
        tools / "apt_packages.sh": '[ "${1:-}" = --ros ] || echo a-package',
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
