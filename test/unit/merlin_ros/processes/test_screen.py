# SPDX-License-Identifier: Apache-2.0
"""What is printed where nothing reads it is lost, keeps nothing waiting, and is shown again later."""

import os
import termios
import tty
from typing import Iterator, Tuple

import pytest

from merlin_ros.processes.screen import Screen


@pytest.fixture(params=["pipe", "terminal"])
def ends(request: pytest.FixtureRequest) -> Iterator[Tuple[int, int]]:
    """What reads, and what is written to."""
    reading, writing = os.openpty() if request.param == "terminal" else os.pipe()
    if request.param == "terminal":
        tty.setraw(writing)
    yield reading, writing
    os.close(reading)
    os.close(writing)


def test_a_screen_that_is_not_read_loses_what_is_too_much(ends: Tuple[int, int]) -> None:
    reading, writing = ends
    screen = Screen(writing)
    assert screen.write(b"." * 1_000_000) == 1_000_000
    assert screen.write(b"lost") == 4
    os.set_blocking(reading, False)
    found = b""
    try:
        while True:
            found += os.read(reading, 65536)
    except BlockingIOError:
        pass
    assert set(found) == set(b".")
    screen.write(b"later")
    os.set_blocking(reading, True)
    assert os.read(reading, 65536) == b"later"


def test_a_terminal_that_is_stopped_keeps_nothing_waiting() -> None:
    reading, writing = os.openpty()
    tty.setraw(writing)
    screen = Screen(writing)
    termios.tcflow(writing, termios.TCOOFF)
    assert screen.write(b"lost") == 4
    termios.tcflow(writing, termios.TCOON)
    screen.write(b"later")
    assert os.read(reading, 100) == b"later"
    assert screen.isatty() and screen.fileno() == writing
    os.close(reading)
    screen.write(b"to nobody")
    os.close(writing)
    assert screen.write(b"nor to a file that is closed") == 28
