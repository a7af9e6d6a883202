# SPDX-License-Identifier: Apache-2.0
"""A profile that does not exist is told before anything is installed."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("command", ["make -s build PROFILE=laptop", "make -s demo PROFILE=laptop"])
def test_an_unknown_profile_is_one_sentence(command: str) -> None:
    done = subprocess.run(command.split(), cwd=str(ROOT), capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(
        "build: PROFILE=laptop is not one of robot, simulation, robot+fleet, simulation+fleet, all; "
        "+deliberation may follow\n"
    )
