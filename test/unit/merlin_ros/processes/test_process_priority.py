# SPDX-License-Identifier: Apache-2.0
"""A process yields to others or goes before them, with all of its threads, where the system allows it."""

import contextlib
import os
import subprocess
import sys
from typing import Any

import pytest

from merlin_test.priorities import may_go_before_others

SCRIPT = """
import os, resource, threading
from merlin_ros.processes.process_priority import lower_priority, raise_priority
{before}
allowed = {call}
later = []
def note():
    later.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
thread = threading.Thread(target=note)
thread.start()
thread.join()
print(allowed, os.getpriority(os.PRIO_PROCESS, 0), *later)
{after}
"""
# Once all is loaded: a checkout of root's may be closed to others; /proc/self is its own (PR_SET_DUMPABLE).
ORDINARY = "import ctypes; os.setuid(65534); ctypes.CDLL(None).prctl(4, 1)"
# Empty where the process is in no group of a session: the kernel may group none, or not this one.
GROUP = "print(open('/proc/self/autogroup').read())"


def run(script: str, **options: Any) -> str:
    command = [sys.executable, "-c", script]
    return subprocess.run(command, capture_output=True, text=True, check=True, **options).stdout.strip()


def answer(before: str = "", after: str = "", call: str = "lower_priority(5)", **options: Any) -> str:
    return run(SCRIPT.format(before=before, after=after, call=call), **options)


def sessions_are_groups() -> bool:
    return os.path.exists("/proc/self/autogroup") and run(GROUP, start_new_session=True) != ""


#: Of a process that is to yield with 5, also where the tests themselves yield.
YIELDING = max(5, os.getpriority(os.PRIO_PROCESS, 0))
grouped = pytest.mark.skipif(not sessions_are_groups(), reason="the kernel does not group by session")


def test_a_process_and_its_later_threads_yield() -> None:
    assert answer() == f"None {YIELDING} {YIELDING}"


@grouped
def test_a_session_of_its_own_yields_as_a_group() -> None:
    assert answer(after=GROUP, start_new_session=True).endswith(f"nice {YIELDING}")


@grouped
def test_all_sessions_that_an_ordinary_user_begins_at_once_yield() -> None:
    before = ORDINARY if os.geteuid() == 0 else ""
    script = SCRIPT.format(before=before, after=GROUP, call="lower_priority(5)")
    with contextlib.ExitStack() as stack:
        begun = [
            stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-c", script],
                    stdout=subprocess.PIPE,
                    text=True,
                    start_new_session=True,
                )
            )
            for _ in range(3)
        ]
        assert all(process.communicate()[0].endswith(f"nice {YIELDING}\n\n") for process in begun)


def test_a_process_that_yields_more_keeps_that_value() -> None:
    # An ordinary user who runs this with nice cannot go back to less.
    assert answer("os.setpriority(os.PRIO_PROCESS, 0, 19)") == "None 19 19"


@grouped
def test_a_session_of_a_process_that_yields_more_does_so_too() -> None:
    said = answer("os.setpriority(os.PRIO_PROCESS, 0, 19)", GROUP, start_new_session=True)
    assert said.endswith("nice 19")


@grouped
def test_a_child_in_a_session_of_its_own_yields_as_its_parent() -> None:
    child = f"from merlin_ros.processes.process_priority import inherit_priority; inherit_priority(); {GROUP}"
    # The parent prints what the child said: of two processes, each may print before the other.
    begin = (
        "import subprocess, sys\n"
        f"command = [sys.executable, '-c', {child!r}]\n"
        "print(subprocess.check_output(command, start_new_session=True, text=True))"
    )
    assert answer(after=begin).endswith(f"nice {YIELDING}")


@pytest.mark.skipif(not may_go_before_others(-10), reason="this user may not raise priorities")
@pytest.mark.parametrize("own_session", [False, True])
def test_a_process_that_may_and_its_later_threads_go_before_others(own_session: bool) -> None:
    assert answer(call="raise_priority(-10)", start_new_session=own_session) == "True -10 -10"


def test_a_process_that_may_not_stays_as_it_is() -> None:
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    before = "resource.setrlimit(resource.RLIMIT_NICE, (0, 0))\n"
    if os.geteuid() == 0:
        before += "os.setgid(65534)\nos.setuid(65534)\n"
    assert answer(before, call="raise_priority(-10)") == f"False {usual} {usual}"
