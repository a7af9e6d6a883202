# SPDX-License-Identifier: Apache-2.0
"""What the supervisor of a run starts again, gives up, and leaves."""

import ctypes
import os
import signal
import subprocess
import sys

import pytest

from merlin.supervision import PAUSES, Restarts

pytestmark = pytest.mark.processes

LIMIT = 200.0  # s for a process to end
PTRACE_SEIZE = 0x4206  # linux/ptrace.h


def test_a_run_that_has_ended_is_not_started_again() -> None:
    code = """
import os, signal
from merlin.supervision import supervise
def run(again, ends):
    print("a life", flush=True)
    ends()
    os.kill(os.getpid(), signal.SIGKILL)
raise SystemExit(supervise(run, "test"))
"""
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, timeout=LIMIT)
    assert (done.returncode, done.stdout) == (137, "a life\n")


def test_a_run_that_a_real_time_signal_has_ended_is_started_again() -> None:
    code = """
import os, signal
from merlin.supervision import supervise
def run(again, ends):
    if not again:
        os.kill(os.getpid(), signal.SIGRTMIN + 3)
    return 7
raise SystemExit(supervise(run, "test"))
"""
    done = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, timeout=LIMIT)
    said = f"test: the run was killed (signal {signal.SIGRTMIN + 3}), its nodes are ended; it is started"
    assert done.returncode == 7 and done.stderr.startswith(said)


def test_a_child_that_cannot_be_killed_is_named_and_left() -> None:
    """One that is traced, as by a debugger, stays after its kill until the tracer has seen its end."""
    code = """
import subprocess, sys
from merlin.supervision import end_children
held = subprocess.Popen(["sleep", "600"])
print(held.pid, flush=True)
sys.stdin.readline()
print(end_children(0.1) == [held.pid])
"""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code], text=True, **pipes) as parent:
        assert parent.stdout is not None
        held = int(parent.stdout.readline())
        if ctypes.CDLL(None).ptrace(PTRACE_SEIZE, held, None, None):
            parent.kill()
            os.kill(held, signal.SIGKILL)
            pytest.skip("no process can be traced here")
        try:
            out, err = parent.communicate("end\n", timeout=LIMIT)
        finally:
            os.kill(held, signal.SIGKILL)
            os.waitpid(held, 0)
    assert (parent.returncode, out) == (0, "True\n")
    assert (
        err == f"process {held} was killed and does not end: it hangs in the kernel, or a debugger holds it\n"
    )


def test_what_dies_again_and_again_is_given_up() -> None:
    now = [0.0]
    restarts = Restarts(30.0, lambda: now[0])
    assert [restarts.died() for _ in range(6)] == [*PAUSES, None]
    assert restarts.words == "for the 6th time within 30 s; it is not started again"
    now[0] = 30.0  # those deaths are too long ago to count
    assert restarts.died() == PAUSES[0]
    assert restarts.words == "it is started again, 1 of 5 times within 30 s"
