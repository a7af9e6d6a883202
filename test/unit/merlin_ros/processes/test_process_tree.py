# SPDX-License-Identifier: Apache-2.0
"""All processes below a process are found, and a child may end with the thread that started it."""

import os
import signal
import subprocess
import sys

import pytest

from merlin_ros.processes import process_tree
from merlin_ros.processes.process_tree import children, descendants
from merlin_test.process_signals import gone

pytestmark = pytest.mark.processes


def test_descendants_are_the_same_with_and_without_the_list_of_the_kernel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    script = "sh -c 'sleep 600 & echo $!; wait' & wait"
    shell = subprocess.Popen(["sh", "-c", script], stdout=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert shell.stdout is not None
        sleep = int(shell.stdout.readline())
        found = {}
        for lists in {process_tree._LISTS, False}:
            monkeypatch.setattr(process_tree, "_LISTS", lists)
            found[lists] = set(descendants(shell.pid))
        assert all(sleep in pids and len(pids) == 2 for pids in found.values()), found
    finally:
        os.killpg(shell.pid, signal.SIGKILL)
        shell.communicate()


def test_children_are_those_of_this_process_until_they_are_waited_for() -> None:
    process = subprocess.Popen(["true"])
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    assert process.pid in children()
    process.wait()
    assert process.pid not in children()


ORPHAN = """
import subprocess, os, sys
from merlin_ros.processes.process_tree import adopt_orphans, children
adopt_orphans()
sh = subprocess.run(["sh", "-c", "sleep 600 >/dev/null & echo $!"], stdout=subprocess.PIPE, text=True)
print(int(sh.stdout) in children())
os.kill(int(sh.stdout), 9)
"""


def test_an_orphan_becomes_a_child_of_the_process_that_asked_for_it() -> None:
    done = subprocess.run([sys.executable, "-c", ORPHAN], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


STARTER = """
import os, signal, subprocess, sys
child = "import os, signal, sys; from merlin_ros.processes.process_tree import end_with;" \
    "print(end_with(int(sys.argv[1]), signal.SIGKILL), os.getpid(), flush=True); signal.pause()"
started = subprocess.Popen([sys.executable, "-c", child, str(os.getpid())], stdout=subprocess.PIPE, text=True)
print(started.stdout.readline(), end="", flush=True)
os.kill(started.pid, signal.SIGSTOP)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_child_that_is_stopped_ends_with_a_killed_starter() -> None:
    done = subprocess.run([sys.executable, "-c", STARTER], capture_output=True, text=True, check=False)
    lives, child = done.stdout.split()
    assert lives == "True" and gone(int(child))


STALLS = """
import itertools, subprocess, time
looks = itertools.count(0.0, 1000.0)  # so much passes before each look at the clock
time.monotonic = lambda: next(looks)
from merlin_ros.processes.process_tree import adopt_orphans, children, end_descendants
adopt_orphans()
subprocess.run(["sh", "-c", "setsid sleep 600 >/dev/null & setsid sleep 600 >/dev/null &"])
print(len(children()), end_descendants(60.0), len(children()))
"""


def test_a_stall_while_descendants_end_is_none_of_theirs() -> None:
    done = subprocess.run([sys.executable, "-c", STALLS], capture_output=True, text=True, check=True)
    assert done.stdout == "2 True 0\n"
