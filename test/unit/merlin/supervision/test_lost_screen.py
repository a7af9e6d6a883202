# SPDX-License-Identifier: Apache-2.0
"""A run whose screen is full, closed, not read or not there goes on to its end, and has all of it in its log.

A command whose reader has left, as `head` does, ends as ever.
"""

import os
import subprocess
from pathlib import Path

import pytest

from merlin_test import LONG
from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

LAUNCH = """<launch>
  <node pkg="merlin_test" type="fake_node.py" name="other" args="talk" required="true"/>
</launch>"""
CLOSED = {"none": "<&- >&- 2>&-", "no output": ">&-"}


@pytest.mark.parametrize("screen", ["full", "closed", "not read", "none", "no output"])
def test_a_run_outlives_its_screen(tmp_path: Path, screen: str) -> None:
    reading, writing = os.pipe()
    if screen == "closed":
        os.close(reading)
    elif screen == "full":
        os.dup2(os.open("/dev/full", os.O_WRONLY), writing)
    launch_file = tmp_path / "talk.launch"
    launch_file.write_text(LAUNCH)
    words = [node_path("merlin", "run"), launch_file]
    if screen in CLOSED:
        words[:0] = ["bash", "-c", f'exec "$@" {CLOSED[screen]}', "bash"]
    env = {**os.environ, "ROS_HOME": str(tmp_path), "ROS_LOG_DIR": str(tmp_path / "log")}
    env.pop("ROS_MASTER_URI", None)
    done = subprocess.run(words, env=env, stdout=writing, stderr=writing, timeout=LONG, check=False)
    os.close(writing)
    log = (tmp_path / "log" / "latest" / "run.log").read_text()
    assert log.count("meant for a screen") == 4000
    assert done.returncode == 1  # of a required node that ends, after all it had to say


def test_a_command_whose_reader_has_left_ends_as_ever() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    words = [node_path("merlin", "new"), "--help"]
    done = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, timeout=LONG, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, b"")
