# SPDX-License-Identifier: Apache-2.0
"""What a robot's computer installs: run-time packages only; a file that is not a package is refused."""

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


def ask(*command: str, **variables: str) -> subprocess.CompletedProcess:
    env = {"PATH": os.environ["PATH"], "OPT_ROS": "/nowhere", **variables}
    return subprocess.run(command, cwd=str(ROOT), env=env, capture_output=True, text=True)


def packages(*words: str) -> set:
    return set(ask("tools/packages.sh", *words).stdout.split())


@pytest.mark.parametrize("profile", ["robot", "simulation", "all"])
def test_what_only_a_build_needs_is_no_dependency(profile: str) -> None:
    running, everything = packages("--run-time", "apt.txt", profile), packages("apt.txt", profile)
    assert running < everything
    assert {"python3-rospy", "rosbash", "ros-std-msgs", "espeak-ng"} <= running
    building = {"build-essential", "cmake", "catkin", "python3-venv", "libstd-msgs-dev", "python3-dev"}
    assert not running & building


def test_a_profile_that_is_none_is_refused() -> None:
    made = ask("tools/deb.sh", PROFILE="robots")
    assert made.returncode == 2 and "PROFILE=robots is not one of" in made.stderr


def test_a_file_that_is_no_package_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.deb").write_text("nothing")
    tried = ask("tools/debian.sh", DEB=str(tmp_path / "x.deb"))
    assert tried.returncode == 1 and "is not a Debian package" in tried.stderr
