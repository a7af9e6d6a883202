# SPDX-License-Identifier: Apache-2.0
"""What is printed or logged where that is not possible is lost, and keeps nothing waiting."""

import fcntl
import os
import select
import subprocess
import sys
import termios
import threading
import time
import tty
from concurrent.futures import ThreadPoolExecutor
from typing import Iterator, Tuple

import pytest

from merlin_ros.processes import screen as screen_module
from merlin_ros.processes.screen import Screen
from merlin_test import LONG


@pytest.fixture(params=["pipe", "terminal"])
def ends(request: pytest.FixtureRequest) -> Iterator[Tuple[int, int]]:
    """What reads, and what is written to."""
    reading, writing = os.openpty() if request.param == "terminal" else os.pipe()
    if request.param == "terminal":
        tty.setraw(writing)
    yield reading, writing
    os.close(reading)
    os.close(writing)


def read_until_later(screen: Screen, reading: int) -> bytes:
    """All that is there, up to what is written when there is room again; a terminal takes a while for it."""
    found, end = b"", time.monotonic() + LONG
    while not found.endswith(b"later") and time.monotonic() < end:
        screen.write(b"later")
        if select.select([reading], [], [], 0.1)[0]:
            found += os.read(reading, 65536)
    return found


def test_a_screen_that_is_not_read_loses_what_is_too_much(ends: Tuple[int, int]) -> None:
    reading, writing = ends
    screen = Screen(writing)
    assert screen.write(b"." * 1_000_000) == 1_000_000
    assert screen.write(b"lost") == 4
    found = read_until_later(screen, reading)
    assert 0 < found.count(b".") < 1_000_000
    assert set(found.lstrip(b".").split(b"later")) == {b""}


def test_a_terminal_that_is_stopped_keeps_nothing_waiting() -> None:
    reading, writing = os.openpty()
    tty.setraw(writing)
    screen = Screen(writing)
    termios.tcflow(writing, termios.TCOOFF)
    assert screen.write(b"lost") == 4
    termios.tcflow(writing, termios.TCOON)
    assert set(read_until_later(screen, reading).split(b"later")) == {b""}
    assert screen.isatty() and screen.fileno() == writing
    os.close(reading)
    screen.write(b"to a terminal that is gone")
    os.close(writing)
    assert screen.write(b"nor to a file that is closed") == 28


LOGS = """
import logging
from merlin_ros.processes.screen import print_without_failing
print_without_failing()
print("“thé”")
log = logging.getLogger()
log.addHandler(logging.FileHandler("/dev/full"))
for number in range(100):
    log.error("line %d", number)
log.handlers[0].stream = open("/dev/null", "w")
log.error("line %d", "wrong")
"""


def test_of_a_log_that_cannot_be_written_it_is_said_once_and_of_a_wrong_line_as_ever() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOGS], capture_output=True, text=True, timeout=LONG, check=True
    )
    first, *rest = done.stderr.splitlines()
    assert first == "/dev/full cannot be written: No space left on device; its lines are lost"
    assert rest[0] == "--- Logging error ---" and rest.count("--- Logging error ---") == 1
    assert "Arguments: ('wrong',)" in rest


def test_several_threads_may_write_to_a_screen_that_is_not_read() -> None:
    reading, writing = os.pipe()
    screen = Screen(writing)
    with ThreadPoolExecutor(8) as threads:
        written = list(threads.map(screen.write, [b"." * 100_000] * 40))
    os.close(reading)
    os.close(writing)
    assert written == [100_000] * 40


def test_room_that_another_writer_takes_keeps_nothing_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(screen_module, "PATIENCE", 0.0)
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, select.PIPE_BUF)  # room for one write
    screens = [Screen(writing) for _ in range(8)]  # as of processes that share it
    begin = threading.Barrier(len(screens))

    def write(screen: Screen) -> int:
        begin.wait(LONG)
        return screen.write(b"." * select.PIPE_BUF)

    with ThreadPoolExecutor(len(screens)) as threads:
        try:
            for _ in range(500):
                assert list(threads.map(write, screens, timeout=LONG)) == [select.PIPE_BUF] * len(screens)
                assert len(os.read(reading, 2 * select.PIPE_BUF)) == select.PIPE_BUF
        finally:
            os.close(reading)  # which ends what waits
    os.close(writing)
