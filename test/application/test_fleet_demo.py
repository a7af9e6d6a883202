# SPDX-License-Identifier: Apache-2.0
"""make fleet, as its users start it."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import List

import pytest
from chaos.under_test.network import why_impossible

DEMO = [sys.executable, str(Path(__file__).resolve().parents[2] / "bench" / "fleet")]
LIMIT = 1300.0  # s, on a machine that tests something else meanwhile
ENDS = 200.0  # s that an interrupted one may take to end


def left_behind(process: int) -> List[str]:
    """Network namespaces that a demonstration has made; others may run beside it."""
    if shutil.which("ip") is None:  # it could not make one
        return []
    spaces = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=False).stdout
    return [line for line in spaces.splitlines() if line.startswith(f"fleet{process}_")]


@pytest.mark.long  # about three minutes
def test_nothing_is_lost_or_done_twice(tmp_path: Path) -> None:
    command = [*DEMO, "--robots", "2", "--results", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as done:
        try:
            said, _ = done.communicate(timeout=LIMIT)
        finally:
            done.kill()
    assert done.returncode == 0, said
    assert said.count("SUCCEEDED by") == 6
    assert " is killed while it executes " in said
    assert ("NO LINK IS CUT" in said) == bool(why_impossible())
    assert (" is mended" in said) != bool(why_impossible())
    assert left_behind(done.pid) == []


def test_an_interrupted_one_leaves_nothing_behind(tmp_path: Path) -> None:
    process = subprocess.Popen([*DEMO, "--results", str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if "the hub is there" in line:
                break
        process.send_signal(signal.SIGINT)
        assert process.wait(ENDS) == 130
    finally:
        if process.poll() is None:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()
    assert left_behind(process.pid) == []
