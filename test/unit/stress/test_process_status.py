# SPDX-License-Identifier: Apache-2.0
"""Threads and memory of a process, read from the kernel's status file."""

import os
import threading

import pytest
from stress.process_status import Usage, usage_in, usage_of

STATUS = """Name:\tpython3
State:\tS (sleeping)
VmPeak:\t  250000 kB
VmRSS:\t   51200 kB
Threads:\t7
Seccomp:\t0
"""


def test_threads_and_memory_are_read() -> None:
    assert usage_in(STATUS) == Usage(7, 50.0)


def test_a_process_that_is_ending_holds_no_memory() -> None:
    assert usage_in("Name:\tpython3\nState:\tZ (zombie)\nThreads:\t1\n") == Usage(1, 0.0)


@pytest.mark.parametrize("text", ["", "no status", "VmRSS: 12 kB\n"])
def test_another_text_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a status file"):
        usage_in(text)


def test_a_thread_more_is_seen() -> None:
    over = threading.Event()
    before = usage_of(os.getpid())
    thread = threading.Thread(target=over.wait, daemon=True)
    thread.start()
    try:
        more = usage_of(os.getpid())
        assert more.threads == before.threads + 1 and more.memory_mb > 1.0
    finally:
        over.set()
        thread.join()


def test_a_process_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(OSError):
        usage_of(2**22 + 1)  # beyond the kernel's largest number of processes
