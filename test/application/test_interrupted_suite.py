# SPDX-License-Identifier: Apache-2.0
"""A suite that is interrupted leaves no node behind, though roslaunch gives each a session of its own.

What another run of it has written stays.
"""

import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from chaos.under_test import processes

TESTS = Path(__file__).parents[1]
SUITE = TESTS / "rostest" / "knowledge" / "timed_knowledge.test"
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


def test_no_process_of_a_test_outlives_an_interrupted_run(tmp_path: Path) -> None:
    starts = "import subprocess\n\ndef test_starts():\n    command = ['sleep', '1000']\n"
    begin = "    subprocess.Popen(command, start_new_session=True)\n"
    wait = "    print('begun', flush=True)\n    subprocess.run(command)\n"
    (tmp_path / "test_sleep.py").write_text(starts + begin + wait)
    command = [sys.executable, "-m", "pytest", "-s", "-p", "no:xdist", "-p", "conftest", str(tmp_path)]
    run = subprocess.Popen(
        command,
        env=dict(os.environ, PYTHONPATH=os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])),
        stdout=subprocess.PIPE,
        text=True,
    )
    mark = processes.SUITE_MARK
    try:
        assert run.stdout is not None
        assert any("begun" in line for line in run.stdout)
        assert processes.marked(str(run.pid), mark=mark)
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=LIMIT)
        assert processes.marked(str(run.pid), mark=mark) == []
    finally:
        run.kill()
        run.wait()
        processes.kill_marked(str(run.pid), mark)
