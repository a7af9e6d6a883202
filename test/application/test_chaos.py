"""The fault campaign, as its users start it.

The whole of it is `make chaos`. Here: that it judges truthfully when nothing breaks, that it ends cleanly,
and a part of it that has to show no violation.
"""

import csv
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Dict, List

import pytest

CAMPAIGN = [sys.executable, str(Path(__file__).resolve().parents[2] / "bench" / "chaos")]
PATIENCE = 4.0  # how many times a limit a machine that tests something else meanwhile may make of it
MINUTES = 10.0  # within which trials begin; the last one and its start come on top
ENDS = 60.0  # s that an interrupted campaign may take to end


def campaign(results: Path, *words: str) -> List[str]:
    return [*CAMPAIGN, "--results", str(results), *words]


def rows(results: Path) -> List[Dict[str, str]]:
    with (results / "trials.csv").open() as file:
        return list(csv.DictReader(file))


def marked(run_of: int) -> List[str]:
    """Command lines of living processes that a campaign has marked and that descend from this test."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            environ = (folder / "environ").read_bytes()
            if f"CHAOS_TEST={run_of}".encode() in environ and b"MERLIN_CHAOS_RUN=" in environ:
                found.append((folder / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return found


@pytest.mark.long
def test_where_nothing_breaks_nothing_is_violated(tmp_path: Path) -> None:
    ended = subprocess.run(
        campaign(tmp_path, "--faults", "nothing", "nothing_cancel"),
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert [row["violations"] for row in rows(tmp_path)] == ["", ""]


@pytest.mark.long
def test_an_interrupted_campaign_leaves_no_process(tmp_path: Path) -> None:
    env = dict(os.environ, CHAOS_TEST=str(os.getpid()))
    process = subprocess.Popen(
        campaign(tmp_path, "--faults", "nothing_cancel", "--trials", "50"),
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    first = process.stdout.readline()
    assert "nothing_cancel" in first, first
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=ENDS)
    assert process.returncode == 130, output
    assert marked(os.getpid()) == []


@pytest.mark.alone
@pytest.mark.timeout(1500)
def test_the_robot_survives_some_minutes_of_faults(tmp_path: Path) -> None:
    ended = subprocess.run(
        campaign(tmp_path, "--minutes", str(MINUTES), "--patience", str(PATIENCE), "--seed", "15"),
        capture_output=True,
        text=True,
        timeout=1480,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert len(rows(tmp_path)) > 0
