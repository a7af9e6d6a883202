# SPDX-License-Identifier: Apache-2.0
"""The mission and the launch file of docs/tutorial.md are short, and run as they are printed."""

import os
import re
import subprocess
from pathlib import Path
from typing import Dict

import pytest

from merlin_test.node_path import node_path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorial.md"
RUN = node_path("merlin", "run")
#: File → most lines, without blank lines and docstrings.
LINES = {"patrol.py": 20, "patrol.launch": 15}


@pytest.fixture
def files(tmp_path: Path) -> Dict[str, Path]:
    found = re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)\n```", PAGE.read_text(), re.DOTALL)
    for name, text in found:
        (tmp_path / name).write_text(text + "\n")
    return {name: tmp_path / name for name, _ in found}


def test_they_are_as_short_as_promised(files: Dict[str, Path]) -> None:
    for name, most in LINES.items():
        lines = [line for line in files[name].read_text().splitlines() if line.strip() and '"""' not in line]
        assert len(lines) <= most, name


def run(folder: Path, launch: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    env = dict(os.environ, PYTHONPATH=path, ROS_HOME=str(folder), ROS_LOG_DIR=str(folder / "log"))
    env.pop("ROS_MASTER_URI", None)
    command = [RUN, str(launch), *words]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=1300, check=False)


@pytest.mark.parametrize(
    ("rooms", "code", "why"),
    [("kitchen", 0, ""), pytest.param("garage", 1, "garage", marks=pytest.mark.long)],
)
def test_they_run(tmp_path: Path, files: Dict[str, Path], rooms: str, code: int, why: str) -> None:
    done = run(tmp_path, files["patrol.launch"], f"rooms:={rooms}", "rtf:=5")
    assert done.returncode == code, done.stdout + done.stderr
    assert why in done.stderr
    assert "Traceback" not in done.stderr


# test_mission_command.py finds such lines in the mission alone, and test_home_application.py at the terminal.
@pytest.mark.long
@pytest.mark.parametrize(
    ("gone", "instead", "why"),
    [
        ('<param name="rooms"', '<param name="room"', "parameter ~rooms is missing"),
        ("patrol:Patrol", "patrol:Petrol", "'patrol:Petrol': module patrol has no Petrol"),
    ],
)
def test_what_is_wrong_with_the_mission_is_one_line(
    tmp_path: Path, files: Dict[str, Path], gone: str, instead: str, why: str
) -> None:
    launch = files["patrol.launch"]
    launch.write_text(launch.read_text().replace(gone, instead))
    done = run(tmp_path, launch)
    assert done.returncode == 2, done.stdout + done.stderr
    assert [line for line in done.stderr.splitlines() if line.startswith(f"mission: {why}")]
    assert "Traceback" not in done.stderr
