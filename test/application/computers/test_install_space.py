# SPDX-License-Identifier: Apache-2.0
"""The install space works without the sources' folders: launch files resolve, nodes start."""

import os
import subprocess
from pathlib import Path

import pytest
from terminal import make_install

pytestmark = pytest.mark.timeout(1500)  # a machine may be slow, and test something else meanwhile
WORKSPACE = Path(__file__).resolve().parents[3]


def installed(command: str, tmp_path: Path) -> subprocess.CompletedProcess:
    """Runs a command in a shell that knows the install space and no other."""
    env = {key: os.environ[key] for key in ("PATH", "HOME")}
    env.update(ROS_HOME=str(tmp_path), ROS_LOG_DIR=str(tmp_path / "log"))
    return subprocess.run(
        ["bash", "-c", f"set -e; . {WORKSPACE}/install/setup.bash; {command}"],
        env=env,
        cwd=str(tmp_path),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1300,
    )


def test_the_install_space_launches_and_runs(tmp_path: Path) -> None:
    make_install()
    nodes = installed("roslaunch --nodes merlin home.launch", tmp_path)
    assert nodes.returncode == 0, nodes.stdout
    assert {"/merlin_sim", "/merlin_executor", "/merlin_bridges", "/mission"} <= set(nodes.stdout.split())
    command = installed("roslaunch --args /merlin_executor merlin home.launch", tmp_path).stdout.split()
    prefix = next(word for word in command if word.endswith("/respawn"))
    assert prefix.startswith(str(WORKSPACE / "install")) and os.access(prefix, os.X_OK), command
    found = installed(
        "python3 -c 'import merlin_executor.node.executor; print(merlin_executor.__file__)'", tmp_path
    )
    assert str(WORKSPACE / "install") in found.stdout, found.stdout
    drawn = installed("rosrun merlin_sim draw_world apartment flat.png", tmp_path)
    assert drawn.returncode == 0, drawn.stdout
    assert (tmp_path / "flat.png").read_bytes().startswith(b"\x89PNG")
