# SPDX-License-Identifier: Apache-2.0
"""A wrong configuration ends the launch, with the reason; a node does not start for ever to say it."""

import os
import subprocess
from pathlib import Path
from typing import List

import pytest

from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

ACTIONS = Path(__file__).parents[3] / "launch" / "include" / "actions.launch"


@pytest.mark.parametrize(
    ("actions", "further", "reason"),
    [
        (
            "['merlin_actions.actions.navigate:Navigat']",
            [],
            "module merlin_actions.actions.navigate has no Navigat",
        ),
        pytest.param(
            "['merlin_actions.no_such_module:Navigate']",
            [],
            "No module named 'merlin_actions.no_such_module'",
            marks=pytest.mark.long,
        ),
        pytest.param(  # test_autonomy_argument.py finds the line in one process
            "['merlin_actions.actions.navigate:Navigate']",
            ["autonomy:=medium"],
            "parameter ~autonomy: 'medium' is not an autonomy level; there are off, low, high, full",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_wrong_argument_ends_the_launch(
    tmp_path: Path, actions: str, further: List[str], reason: str
) -> None:
    done = subprocess.run(
        [node_path("merlin", "run"), str(ACTIONS), f"actions:={actions}", *further],
        env={**os.environ, "ROS_HOME": str(tmp_path), "ROS_LOG_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 2
    assert reason in done.stderr
    assert "required node 'merlin_fsm_host' died with exit code 2" in done.stderr
    assert "started again" not in done.stderr
    assert "Traceback" not in done.stderr
