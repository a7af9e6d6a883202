"""A node that cannot begin says why."""

import os
import subprocess
import sys

import pytest

NO_MASTER = "http://localhost:1"


def begin(master: str, *args: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-c", "from merlin_sm.node import init_node; init_node('asker')", *args],
        env={**os.environ, "ROS_MASTER_URI": master},
        stderr=subprocess.PIPE,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize("master", ["nonsense", "http://", "http://localhost:nowhere", ""])
def test_an_address_that_is_none_is_named(master: str) -> None:
    run = begin(master)
    assert run.returncode == 1
    assert run.stderr.startswith(f"asker: ROS_MASTER_URI is '{master}'; it has to be like http://")
    assert "Traceback" not in run.stderr


def test_a_node_with_parameters_and_no_master_says_so() -> None:
    run = begin(NO_MASTER, "_rate:=1")
    assert run.returncode == 1
    assert run.stderr.startswith(f"asker: no master at {NO_MASTER}: ")
    assert "is roscore running?" in run.stderr
    assert "Traceback" not in run.stderr
