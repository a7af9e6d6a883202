# SPDX-License-Identifier: Apache-2.0
"""Processes of a run are found by their mark, whatever became of them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from chaos.under_test import processes

from merlin_test.process_signals import hang, wait_stopped

pytestmark = pytest.mark.everywhere

SLEEP = "import sys; print('up', flush=True); sys.stdin.read()"


def start(run: str, *words: str) -> subprocess.Popen:
    env = dict(os.environ, **{processes.MARK: run})
    command = [sys.executable, "-c", SLEEP, *words]
    process = subprocess.Popen(
        command, env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )
    assert process.stdout is not None
    process.stdout.readline()
    return process


def test_a_node_is_found_while_it_hangs_and_gone_when_killed() -> None:
    run = f"test{os.getpid()}"
    node, other = start(run, "__name:=one"), start(run, "__name:=two")
    try:
        os.kill(node.pid, signal.SIGSTOP)
        assert processes.node_pid(run, "one", [os.getpid()]) == node.pid
        assert processes.node_pid(run, "three", [os.getpid()]) is None
        assert processes.node_pid(run, "one", [other.pid]) is None
        assert sorted(processes.marked(run)) == sorted([node.pid, other.pid])
        held = processes.usage(node.pid)
        assert held is not None
        assert held.threads == 1
        assert held.memory_mb > 1.0
        assert held.sockets == 0
        assert held.descriptors >= 3
        assert processes.kill_marked(run) == 2
        assert processes.marked(run) == [] or not any(map(processes.alive, processes.marked(run)))
        assert processes.node_pid(run, "one", [os.getpid()]) is None
    finally:
        for process in (node, other):
            process.kill()
            process.communicate()
    assert processes.usage(node.pid) is None


def test_a_process_is_found_while_it_begins_its_program() -> None:
    run = f"test{os.getpid()}"
    for _ in range(200):
        with subprocess.Popen(["sleep", "1000"], env=dict(os.environ, **{processes.MARK: run})) as begins:
            try:
                assert processes.marked(run) == [begins.pid]
            finally:
                begins.kill()


def test_the_node_is_meant_and_not_the_script_that_starts_it_again() -> None:
    run = f"test{os.getpid()}"
    script = Path(__file__).parents[3] / "src" / "merlin" / "scripts" / "respawn"
    process = subprocess.Popen(
        [
            str(script),
            sys.executable,
            "-c",
            "print('up', flush=True); import time; time.sleep(60)",
            "__name:=one",
        ],
        env=dict(os.environ, **{processes.MARK: run}),
        stdout=subprocess.PIPE,
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()
        found = processes.node_pid(run, "one", [os.getpid()])
        assert found is not None and found != process.pid
        assert processes.respawner(found) == process.pid
        assert processes.respawner(process.pid) is None
        os.kill(found, signal.SIGKILL)
        process.stdout.readline()
        assert processes.node_pid(run, "one", [os.getpid()]) not in (None, found, process.pid)
    finally:
        process.terminate()
        process.communicate()


BUSY = """
import threading
for _ in range(20):
    threading.Thread(target=exec, args=("while True: pass",)).start()
print("busy", flush=True)
"""


def test_a_process_that_was_stopped_does_nothing_more() -> None:
    busy = subprocess.Popen([sys.executable, "-c", BUSY], stdout=subprocess.PIPE)
    try:
        assert busy.stdout is not None and busy.stdout.readline() == b"busy\n"
        for _ in range(20):
            hang(busy.pid)
            threads = list(Path(f"/proc/{busy.pid}/task").iterdir())
            states = {(thread / "stat").read_text().rsplit(")", 1)[1].split()[0] for thread in threads}
            assert len(threads) == 21 and states == {"T"}
            os.kill(busy.pid, signal.SIGCONT)
    finally:
        busy.kill()
        busy.communicate()
    wait_stopped(busy.pid)  # it has ended, and nothing is waited for


def test_processes_of_another_run_are_left_alone() -> None:
    node = start("other", "__name:=one")
    try:
        assert processes.node_pid(f"test{os.getpid()}", "one", [os.getpid()]) is None
        assert processes.kill_marked(f"test{os.getpid()}") == 0
        assert processes.alive(node.pid)
    finally:
        node.kill()
        node.communicate()


ENDING = f"""
import os, signal, sys
sys.path.insert(0, {str(Path(__file__).resolve().parents[3] / "bench")!r})
from measuring.tables import end_as_by_ctrl_c
end_as_by_ctrl_c()
try:
    os.kill(os.getpid(), signal.{{first}})
    raise SystemExit("not interrupted")
except KeyboardInterrupt as interrupt:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(os.getpid(), number)
    print("ended by", interrupt)
"""


@pytest.mark.parametrize("first", ["SIGINT", "SIGTERM"])
def test_what_a_signal_ends_comes_to_its_end_whatever_signal_follows(first: str) -> None:
    command = [sys.executable, "-c", ENDING.format(first=first)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"ended by {first}\n", "")
