# SPDX-License-Identifier: Apache-2.0
"""The page of a run that has ended: when it is kept, and that a key or a signal ends it."""

import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
import urllib.request
from pathlib import Path
from typing import Any, Dict, Optional

import pytest
from roslaunch.core import Node

from merlin.launch_request import LaunchRequest
from merlin.linger import Linger, Page, lingers, page_of
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.history_store import HistoryStore
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_test import LONG

pytestmark = [pytest.mark.processes, pytest.mark.everywhere]

KEEP = """
import os, sys
from pathlib import Path
from merlin.linger import Page, keep, terminal
keep(Page(Path(sys.argv[1]), "127.0.0.1", 0), key=terminal())
raise SystemExit(7)
"""


def test_a_run_lingers_when_it_is_asked_to_or_has_a_user() -> None:
    wanted = [(linger, on) for linger in Linger for on in (False, True) if lingers(linger, on)]
    assert wanted == [(Linger.ALWAYS, False), (Linger.ALWAYS, True), (Linger.ON_TERMINAL, True)]


def test_the_command_line_says_so_unless_the_launch_file_has_the_word_itself(tmp_path: Path) -> None:
    plain, own = tmp_path / "plain.launch", tmp_path / "own.launch"
    plain.write_text("<launch/>")
    own.write_text("<launch><arg name='linger' default='3'/></launch>")
    assert LaunchRequest.from_command_line([str(plain)]).linger is Linger.NEVER
    asked = LaunchRequest.from_command_line([str(plain), "linger:=auto"])
    assert asked.linger is Linger.ON_TERMINAL and asked.words() == []
    theirs = LaunchRequest.from_command_line([str(own), "linger:=5"])
    assert theirs.linger is Linger.NEVER and theirs.words() == ["linger:=5"]


@pytest.mark.parametrize(
    ("parameters", "page"),
    [
        (
            {"/ann/page/history": "/r/h.sqlite", "/ann/page/host": "0.0.0.0", "/ann/page/port": 9000},
            Page(Path("/r/h.sqlite"), "0.0.0.0", 9000),
        ),
        ({"/ann/page/history": "/r/h.sqlite"}, Page(Path("/r/h.sqlite"), "127.0.0.1", 8080)),
        ({"/ann/page/history": "~/h.sqlite"}, Page(Path.home() / "h.sqlite", "127.0.0.1", 8080)),
        ({"/ann/page/history": "none"}, None),
        ({"/ann/page/history": "/r/h.sqlite", "/ann/page/port": "9 thousand"}, None),
        ({"/ann/other/history": "/r/h.sqlite"}, None),
    ],
)
def test_the_page_is_that_of_the_launched_monitor(parameters: Dict[str, Any], page: Optional[Page]) -> None:
    other = Node("my_robot", "monitor", name="other", namespace="/ann/")
    monitor = Node("merlin_monitor", "monitor", name="page", namespace="/ann/")
    assert page_of([other, monitor], parameters) == page


def recorded(folder: Path) -> Path:
    """The history of a short run."""
    file = folder / "history.sqlite"
    state = MonitorModel(Inbox(), HistoryStore(file, 1000))
    state.tree.set("meta", "panels", [])
    state.start()
    state.report(Event("mission", "mission 1 succeeded", 5.0))
    state.stop()
    return file


def test_only_what_this_run_has_written_is_its_page(tmp_path: Path) -> None:
    file = recorded(tmp_path)
    page, wall = Page(file, "127.0.0.1", 0), 1_000_000.0
    os.utime(file, (wall, wall))
    assert page.written_since(wall - 1.0) and not page.written_since(wall + 1.0)
    (tmp_path / "history.sqlite-wal").touch()  # the monitor was killed
    assert page.written_since(wall + 1.0)
    assert not Page(tmp_path / "none.sqlite", "", 0).written_since(0.0)


class Kept:
    """A process that keeps a page.

    :param terminal: whether it stands in the foreground of one.
    """

    def __init__(self, file: Path, terminal: bool) -> None:
        self.user, inner = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-c", TERMINAL + KEEP if terminal else KEEP, str(file)],
            stdin=inner if terminal else subprocess.DEVNULL,
            stdout=inner if terminal else subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            cwd=str(Path(__file__).parent),  # a folder below the present one is shown without what is above
        )
        os.close(inner)
        assert self.process.stderr is not None
        self.line = self.process.stderr.readline()
        if self.line.startswith("Traceback"):
            self.line += self.process.stderr.read()

    def shown(self) -> Any:
        """What the page shows."""
        address = next((word for word in self.line.split() if word.startswith("http")), "")
        assert address, self.line
        with urllib.request.urlopen(f"{address}state.json", timeout=LONG) as answer:
            return json.load(answer)["state"]

    def press(self, key: bytes) -> None:
        """Presses a key once keys count singly: what was pressed before is left out."""
        while termios.tcgetattr(self.user)[3] & termios.ICANON:
            assert self.process.poll() is None
            time.sleep(0.01)
        os.write(self.user, key)

    def end(self) -> int:
        code = self.process.wait(timeout=LONG)
        os.close(self.user)
        return code


TERMINAL = """
import fcntl, termios
from merlin_test import LONG
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
"""


def test_a_key_ends_it_on_a_terminal(tmp_path: Path) -> None:
    kept = Kept(recorded(tmp_path), terminal=True)
    assert "a key or Ctrl-C ends it" in kept.line
    state = kept.shown()
    assert state["meta"]["archive"] == str(tmp_path)
    assert [event["text"] for event in state["history"]["events"].values()] == ["mission 1 succeeded"]
    kept.press(b"q")
    assert kept.end() == 7


def test_without_a_terminal_a_signal_ends_it(tmp_path: Path) -> None:
    kept = Kept(recorded(tmp_path), terminal=False)
    assert "(Ctrl-C ends it)" in kept.line
    assert kept.shown()["meta"]["archive"]
    kept.process.send_signal(signal.SIGINT)
    assert kept.end() == 7


def test_a_history_that_cannot_be_shown_is_one_line(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "history.sqlite", terminal=False)
    assert "cannot be kept: there is no history" in kept.line
    assert kept.end() == 7
