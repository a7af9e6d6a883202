# SPDX-License-Identifier: Apache-2.0
"""A suite that is interrupted leaves no node behind, though roslaunch gives each a session of its own.

What another run of it has written stays.
"""

import fcntl
import signal
import subprocess
import sys
import time
from pathlib import Path

from chaos.under_test import processes

SUITE = Path(__file__).parents[1] / "rostest" / "knowledge" / "timed_knowledge.test"
LIMIT = 200.0


def test_no_node_outlives_its_suite(tmp_path: Path) -> None:
    # The suite may run at the same time for itself: its results are below the root.
    command = [sys.executable, "-m", "pytest", "-p", "no:xdist", f"--rootdir={tmp_path}", str(SUITE)]
    other = tmp_path / "results" / "test" / SUITE.stem
    other.mkdir(parents=True)
    lock = (other / "in_use").open("w")
    fcntl.flock(lock, fcntl.LOCK_EX)
    pytest_process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    run = f"{pytest_process.pid}.{SUITE.stem}"
    try:
        end = time.monotonic() + LIMIT
        while not processes.with_word(run, "__name:=rosplan_knowledge_base"):
            assert time.monotonic() < end and pytest_process.poll() is None
            time.sleep(0.05)
        pytest_process.send_signal(signal.SIGINT)
        output, _ = pytest_process.communicate(timeout=LIMIT)
        assert b"KeyboardInterrupt" in output
        assert processes.marked(run) == []
        assert [each.name for each in other.iterdir()] == ["in_use"]
        assert other.with_name(f"{other.name}.2").joinpath("log").is_dir()
    finally:
        lock.close()
        pytest_process.kill()
        pytest_process.wait()
        processes.kill_marked(run)
