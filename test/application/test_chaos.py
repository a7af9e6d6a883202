# SPDX-License-Identifier: Apache-2.0
"""The fault campaign, as its users start it.

The whole of it is `make chaos`. Here: that it judges truthfully when nothing breaks, that it ends cleanly,
and the failures that would hurt most, which must show no violation.
"""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict, List

import pytest

from merlin_test import LONG

CAMPAIGN = [sys.executable, str(Path(__file__).resolve().parents[2] / "bench" / "chaos")]
PATIENCE = 4.0  # how many times a limit a machine that tests something else meanwhile may make of it
#: Each process between a goal and the wheels killed or hung, while the robot drives or speaks.
TEN = [
    "fsm_host_killed_cancel",
    "bridges_and_host_killed",
    "executor_killed",
    "planning_system_killed",
    "navigation_killed",
    "speech_killed",
    "executor_hung_cancel",
    "planning_system_hung_cancel",
    "navigation_hung_cancel",
    "master_hung_cancel",
]


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
    end = time.monotonic() + LONG
    while True:  # a user who does not wait for the end
        process.send_signal(signal.SIGINT)
        try:
            output, _ = process.communicate(timeout=0.1)
            break
        except subprocess.TimeoutExpired:
            assert time.monotonic() < end, "it does not end"
    assert process.returncode == 130, output
    assert marked(os.getpid()) == []


@pytest.mark.timeout(900)
def test_the_robot_survives_the_ten_failures_that_hurt_most(tmp_path: Path) -> None:
    words = ["--patience", str(PATIENCE), "--seed", "15", "--faults", *TEN]
    ended = subprocess.run(campaign(tmp_path, *words), capture_output=True, text=True, timeout=880)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert sorted(row["name"] for row in rows(tmp_path) if row["valid"] == "1") == sorted(TEN)
