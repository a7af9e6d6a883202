"""tools/apt_packages.sh: packages of ROS are left out where another ROS 1 is installed, and nowhere else."""

import os
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
