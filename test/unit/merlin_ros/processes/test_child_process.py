# SPDX-License-Identifier: Apache-2.0
"""A child process answers its starter, ends with it, and leaves nothing when it cannot be started."""

import errno
import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, List

import pytest

from merlin_ros.processes import child_process
from merlin_ros.processes.child_process import ChildProcess, receive, send
from merlin_test import LONG
from merlin_test.process_signals import gone, hang

pytestmark = pytest.mark.processes

WORKER = """
import contextlib, os, sys
from merlin_ros.processes.child_process import parent, receive, send

def main():
    with parent() as channel, contextlib.suppress(EOFError):
        while True:
            send(channel, (sys.argv[1], os.getpid(), receive(channel)))
"""


@pytest.fixture(autouse=True)
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "child_of_a_test.py").write_text(WORKER)
    monkeypatch.syspath_prepend(str(tmp_path))


def test_values_of_any_size_come_and_go_and_it_has_the_modules_of_its_starter() -> None:
    child = ChildProcess("child_of_a_test", "word")
    for value in ("a", {"b": [1, None]}, b"x" * 1_000_000):
        send(child.channel, value)
        assert receive(child.channel) == ("word", child.pid, value)
    assert child.alive and not child.wait(0.0)
    assert child.kill() == -signal.SIGKILL
    assert not child.alive


def test_an_answer_is_waited_for_as_long_as_it_takes() -> None:
    socket.setdefaulttimeout(0.05)  # rospy sets 60 s in each process that subscribes
    try:
        child = ChildProcess("child_of_a_test", "word")
    finally:
        socket.setdefaulttimeout(None)
    hang(child.pid)
    send(child.channel, "a")
    threading.Timer(0.2, os.kill, (child.pid, signal.SIGCONT)).start()
    assert receive(child.channel) == ("word", child.pid, "a")
    child.kill()


def test_it_ends_when_its_socket_closes() -> None:
    child = ChildProcess("child_of_a_test", "word")
    child.channel.close()
    assert child.wait(LONG)
    assert child.kill() == 0


def test_one_that_hangs_is_killed_and_who_waits_for_it_returns() -> None:
    child = ChildProcess("child_of_a_test", "word")
    hang(child.pid)
    ends: List[BaseException] = []

    def wait() -> None:
        try:
            receive(child.channel)
        except (EOFError, OSError) as error:
            ends.append(error)

    waiting = threading.Thread(target=wait)
    waiting.start()
    child.interrupt()
    waiting.join(LONG)
    assert len(ends) == 1
    assert child.kill() == -signal.SIGKILL


STARTER = """
import os, signal
from merlin_ros.processes.child_process import ChildProcess, receive, send
child = ChildProcess("child_of_a_test", "word")
send(child.channel, 1)
receive(child.channel)
print(child.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_it_ends_with_a_killed_starter(tmp_path: Path) -> None:
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}){STARTER}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert gone(int(done.stdout))


def test_one_that_cannot_be_started_leaves_no_descriptor(
    monkeypatch: pytest.MonkeyPatch, open_files: Any
) -> None:
    def none_left(*_: Any, **__: Any) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(child_process.subprocess, "Popen", none_left)
    before = open_files()
    with pytest.raises(OSError, match="Too many"):
        ChildProcess("child_of_a_test", "word")
    assert open_files() <= before
