# SPDX-License-Identifier: Apache-2.0
"""What was reported to the outbox is there after the process was killed, and a full disk loses nothing."""

import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from merlin_fleet.core.records import Report
from merlin_fleet.sqlite_outbox import OutboxError, SqliteOutbox

FIRST = Report("g1", "r1", 7, "SUCCEEDED", "", 1.0)
SECOND = Report("g2", "r1", 9, "ACTION_FAILED", "the door is locked", 2.0)


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "robot" / "outbox.sqlite")


def test_reports_are_there_again_in_their_order(path: str) -> None:
    outbox = SqliteOutbox(path)
    assert outbox.add(FIRST, True) == outbox.add(SECOND, False) == ""
    outbox.close()
    outbox = SqliteOutbox(path)
    assert outbox.reports() == [(FIRST, True), (SECOND, False)]
    outbox.remove("g1", 7)
    outbox.close()
    assert SqliteOutbox(path).reports() == [(SECOND, False)]


def test_a_report_survives_sigkill(path: str) -> None:
    text = (
        "import os, signal, sys\n"
        "from merlin_fleet.core.records import Report\n"
        "from merlin_fleet.sqlite_outbox import SqliteOutbox\n"
        f"SqliteOutbox(sys.argv[1]).add({FIRST!r}, True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", text, path], check=False).returncode == -9
    assert SqliteOutbox(path).reports() == [(FIRST, True)]


def test_a_full_disk_keeps_reports_in_memory_until_there_is_space(path: str) -> None:
    outbox = SqliteOutbox(path)
    (pages,) = outbox._file.execute("PRAGMA page_count").fetchone()
    outbox._file.execute(f"PRAGMA max_page_count = {pages}")
    big = SECOND._replace(reason="x" * 10000)
    assert "full" in outbox.add(big, True)
    assert outbox.reports() == [(big, True)]
    outbox._file.execute("PRAGMA max_page_count = 100000")
    assert outbox.add(FIRST, True) == ""
    outbox.close()
    assert dict(SqliteOutbox(path).reports()) == {big: True, FIRST: True}


def test_a_process_that_begins_while_the_disk_is_full_has_the_reports_of_before(path: str) -> None:
    outbox = SqliteOutbox(path)
    assert outbox.add(FIRST, True) == ""
    outbox.close()
    # As with a full disk nothing can be written: not even the journal of a transaction that changes nothing.
    text = (
        "import resource, signal, sys\n"
        "from merlin_fleet.core.records import Report\n"
        "from merlin_fleet.sqlite_outbox import SqliteOutbox\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
        "outbox = SqliteOutbox(sys.argv[1])\n"
        f"assert outbox.reports() == [({FIRST!r}, True)]\n"
        f"assert outbox.add({SECOND!r}, False)\n"
        f"assert len(outbox.reports()) == 2\n"
    )
    ended = subprocess.run([sys.executable, "-c", text, path], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def test_the_disk_knows_of_a_report_before_add_returns(path: str) -> None:
    outbox = SqliteOutbox(path)
    # FULL leaves the removal of the journal to the kernel: a power cut soon after it takes the report back.
    assert outbox._file.execute("PRAGMA journal_mode").fetchone() == ("delete",)
    assert outbox._file.execute("PRAGMA synchronous").fetchone() == (3,)  # EXTRA


def test_the_fleet_is_remembered(path: str) -> None:
    outbox = SqliteOutbox(path)
    assert outbox.fleet_id == ""
    outbox.note_fleet("ward")
    outbox.close()
    assert SqliteOutbox(path).fleet_id == "ward"


def test_a_path_may_begin_at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    SqliteOutbox("~/outbox.sqlite").note_fleet("ward")  # an argument of roslaunch: no shell replaces its ~
    assert SqliteOutbox(str(tmp_path / "outbox.sqlite")).fleet_id == "ward"


def test_a_file_that_is_not_an_outbox_is_left_alone(tmp_path: Path) -> None:
    text, newer = tmp_path / "text", tmp_path / "newer"
    text.write_text("not a database, but a file of the user's")
    with pytest.raises(OutboxError, match="not a database"):
        SqliteOutbox(str(text))
    assert text.read_text() == "not a database, but a file of the user's"
    with sqlite3.connect(newer) as file:
        file.execute("PRAGMA user_version = 9")
    with pytest.raises(OutboxError, match="version 9"):
        SqliteOutbox(str(newer))
