# SPDX-License-Identifier: Apache-2.0
"""Waits for what a signal does to a process that need not be a child: only a parent gets an event."""

import os
import signal
import time
from pathlib import Path
from typing import Callable, Set

from merlin_test import LONG

LOOK = 0.002  # s between two looks


def gone(pid: int) -> bool:
    """Whether a process ends; a killed one takes a moment to be gone."""
    return _becomes(lambda: _states(Path(f"/proc/{pid}")) <= {"Z"})


def strike(pid: int, number: int) -> None:
    """Sends a signal; a process that it stops stands when this returns."""
    os.kill(pid, number)
    if number == signal.SIGSTOP:
        wait_stopped(pid)


def hang(pid: int) -> None:
    """Stops a process, which stands when this returns."""
    strike(pid, signal.SIGSTOP)


def wait_stopped(pid: int) -> None:
    """Waits until all threads of a process that was sent SIGSTOP stand, or it has ended.

    The thread that gets the signal stops the others. On a busy machine these go on for some hundredths of a
    second, and could answer what comes meanwhile.
    """
    assert _becomes(lambda: _stands(pid)), f"process {pid} was stopped, and works on"


def _stands(pid: int) -> bool:
    try:
        threads = list(Path(f"/proc/{pid}/task").iterdir())
    except (FileNotFoundError, ProcessLookupError):
        return True
    return set().union(*map(_states, threads)) <= {"T", "Z"}


def _states(folder: Path) -> Set[str]:
    """The state of a process or thread; none when it is gone."""
    try:
        return {(folder / "stat").read_text().rsplit(")", 1)[1].split()[0]}
    except (FileNotFoundError, ProcessLookupError):
        return set()


def _becomes(holds: Callable[[], bool]) -> bool:
    end = time.monotonic() + LONG
    while not holds():
        if time.monotonic() >= end:
            return False
        time.sleep(LOOK)
    return True
