# SPDX-License-Identifier: Apache-2.0
"""Waits for the end of processes that are not children of the test."""

import time
from pathlib import Path

from merlin_test import LONG


def gone(pid: int) -> bool:
    """Whether a process ends; a killed one takes a moment to be gone, and only its parent gets an event."""
    end = time.monotonic() + LONG
    while time.monotonic() < end:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except (FileNotFoundError, ProcessLookupError):
            return True
        if state == "Z":
            return True
        time.sleep(0.002)
    return False
