# SPDX-License-Identifier: Apache-2.0
"""No recording is lost when another one begins in its folder."""

import shlex
import subprocess
import sys
from pathlib import Path
from typing import List

import pytest
import roslaunch

from merlin.launch_request import launch_folder

pytestmark = pytest.mark.processes
#: Stands for rosbag's: writes NAME.bag.active, renamed when its standard input is closed.
RECORDER = """
import os
import sys
target = sys.argv[sys.argv.index("--output-name") + 1]
with open(target + ".active", "w") as file:
    file.write(sys.argv[1])
    file.flush()
    print("records", flush=True)
    sys.stdin.read()
os.rename(target + ".active", target)
"""


class Recorder:
    """Records as the launch file has it recorded, a text in place of messages."""

    def __init__(self, folder: Path, text: str) -> None:
        config = roslaunch.config.ROSLaunchConfig()
        loader = roslaunch.xmlloader.XmlLoader()
        file = launch_folder() / "include" / "record.launch"
        loader.load(str(file), config, argv=[f"folder:={folder}"], verbose=False)
        (node,) = [node for node in config.nodes if node.name == "record"]
        command = [sys.executable, "-c", RECORDER, text, *shlex.split(node.args)]
        self._process = subprocess.Popen(
            [*shlex.split(node.launch_prefix), *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        self.said: List[str] = []
        for line in self._process.stdout:
            if line == "records\n":
                break
            self.said.append(line)

    def end(self) -> str:
        """Ends the recording; returns what it said on the screen."""
        return self._process.communicate(timeout=60)[1]

    def kill(self) -> None:
        """Ends it without its bag."""
        self._process.kill()
        self._process.communicate(timeout=60)


def found(folder: Path) -> dict:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_the_newest_recording_has_the_name_and_earlier_ones_have_numbers(tmp_path: Path) -> None:
    folder = tmp_path / "my results"
    for text in ("first", "second", "third"):
        assert Recorder(folder, text).end() == ""
    assert found(folder) == {"run.1.bag": "first", "run.2.bag": "second", "run.bag": "third"}


def test_a_recording_that_was_killed_is_kept(tmp_path: Path) -> None:
    Recorder(tmp_path, "killed").kill()
    later = Recorder(tmp_path, "later")
    assert "run.1.bag.active" in "".join(later.said)
    later.end()
    assert found(tmp_path) == {"run.1.bag.active": "killed", "run.bag": "later"}


def test_two_recorders_at_once_have_a_bag_each(tmp_path: Path) -> None:
    first, second = Recorder(tmp_path, "first"), Recorder(tmp_path, "second")
    assert "run.1.bag" in second.end()
    assert first.end() == ""
    assert found(tmp_path) == {"run.1.bag": "second", "run.bag": "first"}
