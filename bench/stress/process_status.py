# SPDX-License-Identifier: Apache-2.0
"""Threads and memory of a process, as the kernel's ``/proc/<pid>/status`` gives them. Without ROS."""

from pathlib import Path
from typing import NamedTuple


class Usage(NamedTuple):
    """What a process holds."""

    threads: int
    memory_mb: float
    """Resident; 0 for a process that is ending."""


def usage_in(status: str) -> Usage:
    """Reads the text of a status file.

    :raises ValueError: when it is not one.
    """
    fields = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
    if "Threads" not in fields:
        raise ValueError("not a status file: it has no line Threads")
    return Usage(int(fields["Threads"]), float(fields.get("VmRSS", "0").split()[0]) / 1024)


def usage_of(pid: int) -> Usage:
    """Threads and resident memory of a process of this machine.

    :raises OSError: when there is no such process.
    """
    return usage_in(Path(f"/proc/{pid}/status").read_text())
