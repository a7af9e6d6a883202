# SPDX-License-Identifier: Apache-2.0
"""No recording is lost when another one begins in its folder."""

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import List

import pytest
import roslaunch

from merlin.launch_request import launch_folder
from merlin_test import LONG

pytestmark = pytest.mark.processes
#: Stands for rosbag's: writes NAME.bag.active, renamed when it is interrupted; says then when that was.
RECORDER = """
import os
import signal
import sys
import time
from merlin_test import LONG
target = sys.argv[sys.argv.index("--output-name") + 1]
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
with open(target + ".active", "w") as file:
    file.write(sys.argv[1])
    file.flush()
    print("records", os.getpid(), flush=True)
    signal.sigwait([signal.SIGINT])
    print(time.monotonic(), flush=True)
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
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # as roslaunch does
        )
        assert self._process.stdout is not None
        self.said: List[str] = []
        for line in self._process.stdout:
            if line.startswith("records "):
                self._recorder = int(line.split()[1])
                break
            self.said.append(line)

    def end(self, number: int = signal.SIGTERM) -> str:
        """Ends the recording by a signal to the session; returns what was said on the screen."""
        os.killpg(self._process.pid, number)
        self.ended, errors = self._process.communicate(timeout=LONG)
        return errors

    def kill(self) -> None:
        """Ends it without its bag."""
        os.kill(self._recorder, signal.SIGKILL)
        self._process.communicate(timeout=LONG)

    def kill_script(self) -> None:
        """Kills what has started it."""
        self._process.kill()
        self._process.communicate(timeout=LONG)


def found(folder: Path) -> dict:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_the_newest_recording_has_the_name_and_earlier_ones_have_numbers(tmp_path: Path) -> None:
    folder = tmp_path / "my results"
    for text in ("first", "second", "third"):
        assert Recorder(folder, text).end() == ""
    assert found(folder) == {"run.1.bag": "first", "run.2.bag": "second", "run.bag": "third"}


def test_a_folder_below_home_is_written_as_everywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    Recorder(Path("~/bags"), "mine").end()
    assert found(tmp_path / "bags") == {"run.bag": "mine"}


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


def test_an_interrupted_recording_goes_on_for_the_last_words_of_the_others(tmp_path: Path) -> None:
    recorder, before = Recorder(tmp_path, "all"), time.monotonic()
    assert recorder.end(signal.SIGINT) == ""
    assert float(recorder.ended) - before >= 1.0
    assert found(tmp_path) == {"run.bag": "all"}


def test_a_recording_whose_script_was_killed_ends_in_order(tmp_path: Path) -> None:
    Recorder(tmp_path, "all").kill_script()
    assert found(tmp_path) == {"run.bag": "all"}
