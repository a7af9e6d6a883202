# SPDX-License-Identifier: Apache-2.0
"""Chosen tests again and again, and how often each fails."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.processes

REPEAT = [sys.executable, str(Path(__file__).resolve().parents[2] / "tools" / "repeat.py")]
LIMIT = 200.0  # s
#: Fails in each second run.
FLAKY = """
from pathlib import Path
def test_it():
    file = Path(__file__).with_name("runs")
    file.write_text(file.read_text() + "x" if file.exists() else "x")
    assert len(file.read_text()) % 2
def test_other():
    pass
"""


def run(tmp_path: Path, text: str, *words: str) -> "subprocess.Popen[str]":
    (tmp_path / "test_it.py").write_text(text)
    command = [*REPEAT, *words, "--results", str(tmp_path / "results"), "--", "-p", "no:xdist", str(tmp_path)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_the_share_of_failures_is_printed_and_the_outputs_are_kept(tmp_path: Path) -> None:
    with run(tmp_path, FLAKY, "--times", "4", "--load", "1") as process:
        out, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 1, err
    (row,) = [line for line in out.splitlines() if "%" in line]
    assert row.split()[:5] == ["50.0", "%", "2", "of", "4"] and "test_it" in row
    assert "assert" in (tmp_path / "results" / "2.txt").read_text()


def test_a_run_that_crashes_is_counted(tmp_path: Path) -> None:
    crashing = FLAKY.replace("assert len(file.read_text()) % 2", "len(file.read_text()) > 1 or os.abort()")
    with run(tmp_path, f"import os{crashing}", "--times", "2") as process:
        out, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 1, err
    assert " 50.0 %  1 of 2  pytest itself, killed by SIGABRT" in out
    assert "test_it.py" in (tmp_path / "results" / "1.txt").read_text(), "where it crashed"


def test_what_cannot_be_run_is_said_at_once(tmp_path: Path) -> None:
    with run(tmp_path, "import nothing_of_this_name", "--times", "4") as process:
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 2 and "nothing_of_this_name" in err


def test_an_interrupt_ends_it_with_what_is_known(tmp_path: Path) -> None:
    with run(tmp_path, FLAKY.replace("% 2", "% 2 or __import__('threading').Event().wait()")) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=LIMIT)
    assert first.startswith("1: ") and process.returncode == 130, out
    assert "1 runs at load 0" in out
