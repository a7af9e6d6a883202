# SPDX-License-Identifier: Apache-2.0
"""What nodes write to standard error reaches the screen, whatever becomes of the log."""

import contextlib
import os
from pathlib import Path

import pytest

from merlin.error_relay import STDERR, ErrorRelay, LogFile


def test_a_full_disk_keeps_no_line_from_the_screen(capfd: pytest.CaptureFixture) -> None:
    log = LogFile(Path("/dev/full"))
    with ErrorRelay(log), contextlib.redirect_stdout(log):
        for line in (b"one\n", b"two\n"):
            os.write(STDERR, line)
        print("of roslaunch")
    assert capfd.readouterr().err == "one\ntwo\n"


def test_both_write_to_the_log(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    log = LogFile(tmp_path / "run.log")
    with ErrorRelay(log) as relay, contextlib.redirect_stdout(log):
        print("of roslaunch")
        relay.mute()
        os.write(STDERR, b"of a node\n")
    assert capfd.readouterr().err == ""
    assert (tmp_path / "run.log").read_text() == "of roslaunch\nof a node\n"
