"""The guard's process goes before others where the system allows it, and works all the same where not."""

import os
import subprocess
import sys
from typing import Any

import pytest

SCRIPT = """
import os, resource, threading
from merlin_guard.process_priority import raise_priority
{limits}
raised = raise_priority()
later = []
def note():
    later.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
thread = threading.Thread(target=note)
thread.start()
thread.join()
print(raised, os.getpriority(os.PRIO_PROCESS, 0), *later)
"""


def answer(limits: str = "", **options: Any) -> str:
    command = [sys.executable, "-c", SCRIPT.format(limits=limits)]
    return subprocess.run(command, capture_output=True, text=True, check=True, **options).stdout.strip()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root")
@pytest.mark.parametrize("own_session", [False, True])
def test_a_process_that_may_and_its_later_threads_go_before_others(own_session: bool) -> None:
    assert answer(start_new_session=own_session) == "True -10 -10"


def test_a_process_that_may_not_stays_as_it_is() -> None:
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    limits = "resource.setrlimit(resource.RLIMIT_NICE, (0, 0))\n"
    if os.geteuid() == 0:
        limits += "os.setgid(65534)\nos.setuid(65534)\n"
    assert answer(limits) == f"False {usual} {usual}"
