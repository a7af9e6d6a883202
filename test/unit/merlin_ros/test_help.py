# SPDX-License-Identifier: Apache-2.0
"""Every command of rosrun says with --help what it is, without a master, and ends with 0."""

import os
import subprocess
from pathlib import Path

import pytest

from merlin_test import LONG
from merlin_test.node_path import node_path

SOURCE = Path(__file__).resolve().parents[3] / "src"
SCRIPTS = sorted(path for path in SOURCE.glob("*/scripts/*") if path.is_file())
#: One of each way in which a script begins.
FAST = {
    *("merlin/check", "merlin/reload", "merlin/respawn", "merlin_actions/simulated_action_server"),
    *("merlin_executor/mission", "merlin_guard/guard", "merlin_monitor/top", "merlin_sim/poi_distances"),
}
#: Of those, what `rosrun` itself starts here; of the others, the file that it would start.
BY_ROSRUN = {"merlin/check", "merlin/respawn"}

pytestmark = pytest.mark.processes


def name(script: Path) -> str:
    return f"{script.parents[1].name}/{script.name}"


@pytest.mark.parametrize(
    "script",
    [pytest.param(s, id=name(s), marks=[] if name(s) in FAST else [pytest.mark.long]) for s in SCRIPTS],
)
def test_a_command_says_what_it_is(script: Path) -> None:
    words = script.parents[1].name, script.name
    # rosrun itself takes twice as long to find most of them as they take to answer.
    command = ["rosrun", *words] if name(script) in BY_ROSRUN else [node_path(*words)]
    done = subprocess.run(
        [*command, "--help"],
        env={**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=LONG,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() and "Traceback" not in done.stderr
