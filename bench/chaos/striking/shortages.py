# SPDX-License-Identifier: Apache-2.0
"""Strokes on what a node holds of its machine: its ports, its descriptors, its threads."""

import contextlib
import os
import resource
import socket
import threading
import time
from pathlib import Path
from typing import Iterable, List, Tuple

from chaos.faults import Fault
from chaos.striking.stroke import Stroke
from chaos.under_test import processes
from chaos.under_test.system import System

#: s for a control group to be empty.
EMPTY_LIMIT = 1.0
#: s between two attempts to be accepted by a node that has no descriptor.
KNOCK = 0.05
#: The hierarchy of the kernel that limits processes and threads.
PIDS = Path("/sys/fs/cgroup/pids")


def first_free(used: Iterable[int]) -> int:
    """The lowest number that is not used: a limit of so many leaves no descriptor free."""
    taken = set(used)
    return next(number for number in range(len(taken) + 1) if number not in taken)


def knock(ports: List[int]) -> List[socket.socket]:
    """A connection to each port of this machine; nothing waits until it is taken."""
    opened = []
    for port in ports:
        each = socket.socket()
        each.setblocking(False)
        each.connect_ex(("127.0.0.1", port))
        opened.append(each)
    return opened


class Sockets(Stroke):
    """Connections to all ports of a node that say nothing, until the trial's end."""

    def __init__(self, system: System, fault: Fault) -> None:
        super().__init__(system, fault)
        self._ports = processes.listening_ports(self._running(fault.on))
        self._held: List[socket.socket] = []

    def strike(self) -> None:
        """Opens them."""
        for _ in range(int(self._fault.amount)):
            self._held += knock(self._ports)

    def end(self) -> None:
        """Closes them."""
        while self._held:
            self._held.pop().close()


class Descriptors(Stroke):
    """A node without a free descriptor, whose ports get connections meanwhile."""

    def __init__(self, system: System, fault: Fault) -> None:
        super().__init__(system, fault)
        self._pid = self._running(fault.on)
        self._ports = processes.listening_ports(self._pid)
        self._before = resource.prlimit(self._pid, resource.RLIMIT_NOFILE)
        self._over = threading.Event()
        # Ends with end().
        self._thread = threading.Thread(target=self._keep_short, name="descriptors", daemon=True)

    def strike(self) -> None:
        """Takes them."""
        self._tighten()
        self._thread.start()

    def end(self) -> None:
        """Gives them back."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        self._limit(self._before)

    def _keep_short(self) -> None:
        while not self._over.wait(KNOCK):
            self._tighten()
            # One that stays would keep the node from taking the next: that is another fault.
            for each in knock(self._ports):
                each.close()

    def _tighten(self) -> None:
        with contextlib.suppress(OSError):  # it has ended
            used = [int(name) for name in os.listdir(f"/proc/{self._pid}/fd")]
            self._limit((first_free(used), self._before[1]))

    def _limit(self, limits: Tuple[int, int]) -> None:
        with contextlib.suppress(OSError):
            resource.prlimit(self._pid, resource.RLIMIT_NOFILE, limits)


class Threads(Stroke):
    """A node that can start no thread and no process, for as long as it lives.

    A limit of processes (RLIMIT_NPROC) does not bind root, so a control group of the node's own does it.
    """

    def __init__(self, system: System, fault: Fault) -> None:
        super().__init__(system, fault)
        self._pid = self._running(fault.on)
        self._home = PIDS / pids_group(Path(f"/proc/{self._pid}/cgroup").read_text()).lstrip("/")
        self._group = self._home / f"{system.run}_{self._pid}"

    def strike(self) -> None:
        """Takes them."""
        self._group.mkdir(exist_ok=True)
        (self._group / "cgroup.procs").write_text(str(self._pid))
        (self._group / "pids.max").write_text("0")

    def end(self) -> None:
        """Gives them back; a node that was started again has them already."""
        if not self._group.exists():
            return
        with contextlib.suppress(OSError):
            for pid in (self._group / "cgroup.procs").read_text().split():
                (self._home / "cgroup.procs").write_text(pid)
        end = time.monotonic() + EMPTY_LIMIT
        while self._group.exists() and time.monotonic() < end:
            try:
                self._group.rmdir()
            except OSError:  # one that ends is in it for a moment
                time.sleep(KNOCK)


def pids_group(text: str) -> str:
    """The control group of a process, from its file cgroup.

    :raises LookupError: there is none.
    """
    for line in text.splitlines():
        _, controllers, group = line.split(":", 2)
        if "pids" in controllers.split(","):
            return group
    raise LookupError("no control group limits its threads")


def why_no_threads() -> str:
    """Why a node's threads cannot be limited; empty when they can."""
    if os.geteuid() != 0:
        return "limiting the threads of a node needs root"
    if not os.access(PIDS, os.W_OK):
        return f"there is no control group {PIDS} that could limit threads (version 1, writable)"
    tried = PIDS / f"chaos_tried{os.getpid()}"
    try:
        tried.mkdir()
        tried.rmdir()
    except OSError as error:
        return f"control groups are refused: {error}"
    return ""
