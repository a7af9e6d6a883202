# SPDX-License-Identifier: Apache-2.0
"""A stall of the supervisor is none of the processes that it ends: its limits count its own looks."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.processes

LIMIT = 200.0  # s for a process to end
#: 1000 s pass before each look at the clock; from the fourth one on `come` has been called.
STALLS = """
import itertools, os, signal, subprocess, sys, threading, time
looks = itertools.count()
def stalled():
    look = next(looks)
    if look == 3:
        come()
    return 1000.0 * look
time.monotonic = stalled
from merlin import supervision
"""
NODE = """
import os, signal, sys
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
os.write(int(sys.argv[1]), b"x")
signal.sigwait([signal.SIGINT])
os.read(int(sys.argv[2]), 1)
print("ended in order", flush=True)
"""


def output(code: str) -> str:
    """What a process prints, and complains of."""
    both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return subprocess.run([sys.executable, "-c", STALLS + code], text=True, timeout=LIMIT, **both).stdout


def test_a_child_whose_end_is_seen_after_a_stall_does_not_hang() -> None:
    code = """
ended, wait = threading.Event(), os.waitpid
come = ended.set
os.waitpid = lambda process, options: (options or ended.wait()) and wait(process, options)
child = subprocess.Popen(["sleep", "600"])
print(supervision.end_children(60.0) == [child.pid])
"""
    assert output(code) == "True\n"


def test_nodes_of_a_run_that_was_killed_end_in_order_while_the_supervisor_stalls() -> None:
    code = f"""
supervision.END_LIMIT = 60.0
(begins, began), (reads, writes) = os.pipe(), os.pipe()
come = lambda: os.write(writes, b"x")
def run(again, ends):
    node = [sys.executable, "-c", {NODE!r}, str(began), str(reads)]
    subprocess.Popen(node, pass_fds=[reads, began], start_new_session=True)
    os.read(begins, 1)
    ends()
    os.kill(os.getpid(), signal.SIGKILL)
raise SystemExit(supervision.supervise(run, "test"))
"""
    assert output(code) == "ended in order\n"
