"""Makes sure that a run leaves no process behind, whatever its nodes did with their children.

Linux gives a process whose parent died to the nearest ancestor that asked for it; this process asks.
So at the end everything that is left is a child of ours, and can be ended without guessing by name.
"""

import ctypes
import os
import signal
from typing import List

PR_SET_CHILD_SUBREAPER = 36


def adopt_orphans() -> bool:
    """Makes this process the new parent of grandchildren that lose theirs.

    :return: false where the system has no such thing (not Linux); then only direct children are found.
    """
    try:
        return ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0) == 0
    except (OSError, AttributeError):
        return False


def children() -> List[int]:
    """Process ids of the children of this process, ended ones that were not waited for included."""
    found = []
    for entry in os.listdir("/proc"):
        if not entry.isdigit():
            continue
        try:
            with open(f"/proc/{entry}/stat") as file:
                parent = int(file.read().rsplit(")", 1)[1].split()[1])
        except OSError:
            continue  # it ended between the listing and the look
        if parent == os.getpid():
            found.append(int(entry))
    return found


def end_children() -> List[int]:
    """Kills and reaps all children of this process, and theirs as they are adopted.

    :return: the ids of those that were still running.
    """
    killed: List[int] = []
    while True:
        left = children()
        if not left:
            return killed
        for process in left:
            if os.waitpid(process, os.WNOHANG)[0] == 0:
                killed.append(process)
                os.kill(process, signal.SIGKILL)
                os.waitpid(process, 0)
