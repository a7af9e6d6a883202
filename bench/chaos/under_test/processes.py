# SPDX-License-Identifier: Apache-2.0
"""Finds the processes of a system under test, and what they hold.

Each of them carries a mark in its environment, so they are found without asking a node or the master, hung
ones and those that left their process group included.
"""

import contextlib
import os
import signal
import time
from pathlib import Path
from typing import List, NamedTuple, Optional, Sequence

#: Environment variable with the name of the run.
MARK = "MERLIN_CHAOS_RUN"
#: The same with the process of a run of tests.
SUITE_MARK = "MERLIN_TEST_SUITE"
#: s that a killed process may take to disappear.
END_LIMIT = 5.0
#: Where /proc/PID/stat has the two ends of what such a file shows, after the name; see proc(5).
PLACES = {"cmdline": slice(45, 47), "environ": slice(47, 49)}
#: State of a socket in /proc/net/tcp that takes connections.
LISTENS = "0A"


class Usage(NamedTuple):
    """What a process holds."""

    memory_mb: float
    threads: int
    descriptors: int
    sockets: int


def marked(run: str, proc: Path = Path("/proc"), mark: str = MARK) -> List[int]:
    """Ids of all living processes of a run, this one not among them."""
    return [pid for pid in ids(proc) if is_marked(run, pid, proc, mark)]


def is_marked(run: str, pid: int, proc: Path = Path("/proc"), mark: str = MARK) -> bool:
    """Whether a process belongs to a run and is not this one."""
    return pid != os.getpid() and f"{mark}={run}".encode() in _fields(proc, pid, "environ")


def ids(proc: Path = Path("/proc")) -> List[int]:
    """Ids of all processes."""
    return [int(entry.name) for entry in proc.iterdir() if entry.name.isdigit()]


def node_pid(run: str, node: str, parents: Sequence[int], proc: Path = Path("/proc")) -> Optional[int]:
    """The process of a node, the newest of several; None when there is none.

    :param parents: the processes that start nodes. A child that a dead node has left behind has the command
        line of the node, but another parent.
    """
    word = f"__name:={node}".encode()
    named = {pid: _parent(proc, pid) for pid in marked(run, proc) if word in _fields(proc, pid, "cmdline")}
    # What starts a node again has its command line, too.
    again = {pid for pid, parent in named.items() if parent in parents and _starts_again(proc, pid)}
    found = [
        pid for pid, parent in named.items() if parent in again or (parent in parents and pid not in again)
    ]
    return max(found, key=lambda pid: _started(proc, pid)) if found else None


def respawner(pid: int, proc: Path = Path("/proc")) -> Optional[int]:
    """The process that starts a node again when it dies; None when there is none.

    :param pid: of the node.
    """
    parent = _parent(proc, pid)
    return parent if _starts_again(proc, parent) else None


def with_word(run: str, word: str, proc: Path = Path("/proc")) -> List[int]:
    """Ids of the processes of a run of whose command line a word ends with a text."""
    wanted = word.encode()
    return [
        pid
        for pid in marked(run, proc)
        if any(field.endswith(wanted) for field in _fields(proc, pid, "cmdline"))
    ]


def usage(pid: int, proc: Path = Path("/proc")) -> Optional[Usage]:
    """What a process holds; None when it has ended."""
    folder = proc / str(pid)
    try:
        fields = dict(
            line.split(":", 1) for line in (folder / "status").read_text().splitlines() if ":" in line
        )
        links = [os.readlink(entry) for entry in (folder / "fd").iterdir() if entry.is_symlink()]
    except (OSError, ValueError):
        return None
    memory = float(fields.get("VmRSS", "0 kB").split()[0]) / 1024
    sockets = sum(link.startswith("socket:") for link in links)
    return Usage(memory, int(fields["Threads"]), len(links), sockets)


def listening_ports(pid: int, proc: Path = Path("/proc")) -> List[int]:
    """The TCP ports at which a process listens: those of a node are its two APIs, XML-RPC and TCPROS."""
    sockets, ports = set(), set()
    try:
        for entry in (proc / str(pid) / "fd").iterdir():
            with contextlib.suppress(FileNotFoundError):  # closed meanwhile
                sockets.add(os.readlink(entry))
        lines = (proc / str(pid) / "net" / "tcp").read_text().splitlines()[1:]
    except OSError:  # it has ended
        return []
    for line in lines:
        fields = line.split()
        if fields[3] == LISTENS and f"socket:[{fields[9]}]" in sockets:
            ports.add(int(fields[1].rsplit(":", 1)[1], 16))
    return sorted(ports)


def kill_marked(run: str, mark: str = MARK) -> int:
    """Kills every process of a run, those that they start meanwhile included; returns how many."""
    killed = set()
    end = time.monotonic() + END_LIMIT
    while time.monotonic() < end:
        left = [pid for pid in marked(run, mark=mark) if not _zombie(pid)]
        if not left:
            break
        for pid in left:
            send(pid, signal.SIGKILL)
            killed.add(pid)
        reap()
        time.sleep(0.02)  # the kernel reports an end to the parent only
    return len(killed)


def send(pid: int, number: int) -> bool:
    """Sends a signal; False when the process has ended already."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return False
    return True


def reap() -> None:
    """Takes away ended grandchildren that this process has adopted.

    Children of subprocess.Popen are left alone as long as Popen knows them: it finds them ended all the same.
    """
    for pid in ids():
        if _parent(Path("/proc"), pid) == os.getpid() and _zombie(pid):
            try:
                os.waitpid(pid, os.WNOHANG)
            except ChildProcessError:
                continue


def alive(pid: int) -> bool:
    """Whether a process is there and not a zombie."""
    return Path(f"/proc/{pid}").exists() and not _zombie(pid)


def _fields(proc: Path, pid: int, name: str) -> List[bytes]:
    """The environment or the command line of a process.

    Both are empty for a moment while a process begins another program, and Popen is done before it ends.
    """
    end = time.monotonic() + END_LIMIT
    while True:
        try:
            text = (proc / str(pid) / name).read_bytes()
            if text or _is_empty(proc, pid, name) or time.monotonic() > end:
                return text.split(b"\0")
        except (OSError, ValueError):  # it has ended
            return []
        time.sleep(0.001)


def _is_empty(proc: Path, pid: int, name: str) -> bool:
    """Whether a process has an empty environment or command line; raises OSError for one of the kernel."""
    os.readlink(proc / str(pid) / "exe")
    start, end = _stat(proc, pid)[PLACES[name]]
    return start == end != "0"


def _starts_again(proc: Path, pid: int) -> bool:
    """Whether a process is the script `respawn` of the package merlin."""
    return any(field.endswith(b"/respawn") for field in _fields(proc, pid, "cmdline")[:3])


def _stat(proc: Path, pid: int) -> List[str]:
    try:
        return (proc / str(pid) / "stat").read_text().rsplit(")", 1)[1].split()
    except (OSError, IndexError):
        return []


def _parent(proc: Path, pid: int) -> int:
    fields = _stat(proc, pid)
    return int(fields[1]) if fields else -1


def _started(proc: Path, pid: int) -> int:
    fields = _stat(proc, pid)
    return int(fields[19]) if fields else -1


def _zombie(pid: int) -> bool:
    fields = _stat(Path("/proc"), pid)
    return not fields or fields[0] in ("Z", "X")
