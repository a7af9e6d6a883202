# SPDX-License-Identifier: Apache-2.0
"""Everything a process has started: found, measured and ended, sessions of its own included."""

import contextlib
import ctypes
import os
import signal
from typing import Callable, Dict, List, NamedTuple

from merlin_ros.alarms import wait_ticks

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36  # linux/prctl.h
_LISTS = os.path.exists(f"/proc/self/task/{os.getpid()}/children")  # not every kernel is built with it
_LIBRARY = ctypes.CDLL(None, use_errno=True)  # not loaded between a fork and what the child executes
_PAGE = os.sysconf("SC_PAGE_SIZE")


class TreeSize(NamedTuple):
    """What the descendants of a process use."""

    processes: int
    memory: int  #: bytes in physical memory


def adopt_orphans() -> None:
    """Makes the calling process the parent of every orphan below it, so that none can leave its tree.

    :raises OSError: the kernel refuses.
    """
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)


def end_with(starter: int, number: int) -> bool:
    """Has the kernel send the calling process a signal when the thread that started it ends.

    :param starter: process id of that thread's process.
    :param number: the signal.
    :return: whether that process lives; otherwise the signal never comes.
    :raises OSError: the kernel refuses.
    """
    _prctl(_PR_SET_PDEATHSIG, number)
    return os.getppid() == starter


def _prctl(option: int, value: int) -> None:
    if _LIBRARY.prctl(option, value, 0, 0, 0):
        raise OSError(ctypes.get_errno(), f"prctl {option}")


def children() -> List[int]:
    """Process ids of the children of this process, ended ones that were not waited for included."""
    return _children()(os.getpid())


def descendants(root: int) -> List[int]:
    """Process ids below a process, without itself.

    A process that ends meanwhile may hide another one: ask again after its end.
    """
    of = _children()
    found: List[int] = []
    waiting = [root]
    while waiting:
        below = of(waiting.pop())
        found.extend(below)
        waiting.extend(below)
    return found


def _children() -> Callable[[int], List[int]]:
    return _listed_children if _LISTS else _scanned_children()


def _listed_children(pid: int) -> List[int]:
    """The kernel's own list, where it has one: a look at every process takes fifty times as long."""
    found: List[int] = []
    with contextlib.suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            with contextlib.suppress(OSError), open(f"/proc/{pid}/task/{task}/children", "rb") as file:
                found.extend(int(child) for child in file.read().split())
    return found


def _scanned_children() -> Callable[[int], List[int]]:
    children: Dict[int, List[int]] = {}
    for name in os.listdir("/proc"):
        if name.isdigit():
            with contextlib.suppress(OSError), open(f"/proc/{name}/stat", "rb") as file:
                # The command's name may hold blanks and parentheses; what follows its last one cannot.
                parent = int(file.read().rsplit(b")", 1)[1].split()[1])
                children.setdefault(parent, []).append(int(name))
    return lambda pid: children.get(pid, [])


def tree_size(root: int) -> TreeSize:
    """How many processes there are below a process, and their memory."""
    memory = 0
    pids = descendants(root)
    for pid in pids:
        with contextlib.suppress(OSError, IndexError), open(f"/proc/{pid}/statm", "rb") as file:
            memory += int(file.read().split()[1]) * _PAGE
    return TreeSize(len(pids), memory)


def end_descendants(limit: float) -> bool:
    """Kills and reaps everything below the calling process, which must have called :func:`adopt_orphans`.

    :param limit: s of its own time; a process in an uninterruptible call of the kernel outlives its kill.
    :return: whether none is left.
    """
    # Blocked, the end of a child waits for sigtimedwait and is not lost to a handler.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])
    try:
        # A stopped process starts no further one while the others are killed.
        _send(descendants(os.getpid()), signal.SIGSTOP)
        return wait_ticks(_end_all, limit)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_all(seconds: float) -> bool:
    _send(descendants(os.getpid()), signal.SIGKILL)
    if _reap():
        signal.sigtimedwait([signal.SIGCHLD], seconds)
    return not _reap()


def _send(pids: List[int], number: int) -> None:
    for pid in pids:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(pid, number)


def _reap() -> bool:
    """Reaps the children that have ended; returns whether others are left."""
    while True:
        try:
            pid, _ = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return False
        if pid == 0:
            return True
