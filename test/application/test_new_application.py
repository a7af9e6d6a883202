# SPDX-License-Identifier: Apache-2.0
"""What `rosrun merlin new` writes builds, runs and passes its test as it is, over devel and install."""

import sys
from pathlib import Path

import pytest
from terminal import ROOT, make_install, run_in_shell

pytestmark = pytest.mark.timeout(1800)  # it builds and runs more than once
NEW = (
    "rosrun merlin new my_robot --type 'cup - object' "
    "--action 'fetch ?o - cup ?from ?to - place' --action 'look-at ?p - poi'"
)


def shell(space: str, commands: str, folder: Path) -> str:
    """Runs commands in a new shell over one space of MERLIN; returns what they print."""
    return run_in_shell(f". {ROOT}/{space}/setup.bash\n{commands}", folder, folder)


def build(target: str) -> str:
    return f"cd my_robot_ws; catkin_make -DPYTHON_EXECUTABLE={sys.executable} {target}"


# test_hello.py does much of this with a package of one action.
@pytest.mark.long
def test_the_new_package_is_built_and_tested_over_the_devel_space(tmp_path: Path) -> None:
    shell("devel", NEW, tmp_path)
    shell("devel", build(""), tmp_path)
    overlay = ". my_robot_ws/devel/setup.bash; cd my_robot_ws; "
    tests = "python -m pytest src/my_robot; catkin_make run_tests; catkin_test_results"
    said = shell("devel", f"{overlay} {tests}", tmp_path)
    assert "6 passed" in said, said
    assert "3 tests, 0 errors, 0 failures" in said, said
    said = shell("devel", f"{overlay} rosrun merlin run my_robot my_robot.launch rtf:=0", tmp_path)
    assert "next: (look-at_done hall)" in said, said


def install(tmp_path: Path) -> str:
    """Installs the new package over the install space; returns the words of a shell that knows it alone."""
    make_install()
    shell("install", NEW, tmp_path)
    package = tmp_path / "my_robot_ws" / "src" / "my_robot"
    lint = shell("install", f"catkin_lint -q -W2 --strict {package}", tmp_path)
    assert not lint.strip()
    shell("install", build("install"), tmp_path)
    (tmp_path / "my_robot_ws" / "src").rename(tmp_path / "sources_are_not_used")
    return ". my_robot_ws/install/setup.bash; "


def test_the_new_package_runs_over_the_install_space(tmp_path: Path) -> None:
    overlay = install(tmp_path)
    said = shell("install", f"{overlay} rosrun merlin run my_robot my_robot.launch on:=servers", tmp_path)
    assert "next: (look-at_done hall)" in said, said


# test_hello.py runs it over the devel space.
@pytest.mark.long
def test_the_test_of_the_new_package_passes_over_the_install_space(tmp_path: Path) -> None:
    shell("install", f"{install(tmp_path)} rostest my_robot my_robot.test", tmp_path)
