"""A node that cannot begin says why."""

import os
import subprocess
import sys

NO_MASTER = "http://localhost:1"


def test_a_node_with_parameters_and_no_master_says_so() -> None:
    run = subprocess.run(
        [sys.executable, "-c", "from merlin_sm.node import init_node; init_node('asker')", "_rate:=1"],
        env={**os.environ, "ROS_MASTER_URI": NO_MASTER},
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
    )
    assert run.returncode == 1
    assert run.stderr.startswith(f"asker: no master at {NO_MASTER}: ")
    assert "is roscore running?" in run.stderr
    assert "Traceback" not in run.stderr
