# SPDX-License-Identifier: Apache-2.0
"""What a node holds is taken from it, and given back."""

import os
import resource
import socket
import subprocess
import sys
from typing import Iterator, List, Optional, Set

import pytest
from chaos.faults import DESCRIPTORS, SOCKETS, THREADS, Fault
from chaos.striking.shortages import (
    Descriptors,
    Sockets,
    Threads,
    first_free,
    pids_group,
    why_no_threads,
)
from chaos.striking.stroke import NotRunning
from chaos.under_test import processes
from hypothesis import given
from hypothesis import strategies as st

#: A server that says what came of opening a file, or of starting a thread, line by line.
SERVER = """
import socket, sys, threading
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
for line in sys.stdin:
    try:
        if line == "open\\n":
            open("/dev/null").close()
        else:
            threading.Thread(target=int).start()
        print("done", flush=True)
    except (OSError, RuntimeError) as error:
        print(getattr(error, "strerror", error), flush=True)
"""


class Node:
    """A process in the place of a system's node."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process
        assert process.stdout is not None
        self.port = int(process.stdout.readline())
        self.run = f"test{os.getpid()}"

    def pid(self, node: str) -> Optional[int]:
        return self.process.pid if node == "node" else None

    def does(self, what: str) -> str:
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(f"{what}\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()


@pytest.fixture
def node() -> Iterator[Node]:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SERVER], text=True, **pipes) as process:  # type: ignore[call-overload]
        yield Node(process)
        process.kill()


@given(st.sets(st.integers(0, 30)))
def test_a_limit_of_so_many_descriptors_leaves_none_free(used: Set[int]) -> None:
    limit = first_free(used)
    assert limit not in used and set(range(limit)) <= used


def test_the_ports_of_a_process_are_found(node: Node) -> None:
    assert processes.listening_ports(node.process.pid) == [node.port]


def test_a_process_without_ports_has_none() -> None:
    with subprocess.Popen(["sleep", "60"]) as process:
        assert processes.listening_ports(process.pid) == []
        process.kill()


def test_a_node_has_no_free_descriptor_until_the_end(node: Node) -> None:
    before = resource.prlimit(node.process.pid, resource.RLIMIT_NOFILE)
    stroke = Descriptors(node, Fault("d", DESCRIPTORS, lasts=2.0, on="node"))  # type: ignore[arg-type]
    stroke.strike()
    assert node.does("open") == os.strerror(24)
    stroke.end()
    assert node.does("open") == "done"
    assert resource.prlimit(node.process.pid, resource.RLIMIT_NOFILE) == before


@pytest.mark.skipif(bool(why_no_threads()), reason=why_no_threads())
def test_a_node_can_start_no_thread_until_the_end(node: Node) -> None:
    stroke = Threads(node, Fault("t", THREADS, on="node"))  # type: ignore[arg-type]
    assert node.does("start") == "done"
    stroke.strike()
    assert "can't start new thread" in node.does("start")
    stroke.end()
    assert node.does("start") == "done"


def test_silent_connections_last_until_the_end(node: Node) -> None:
    stroke = Sockets(node, Fault("s", SOCKETS, on="node", amount=3))  # type: ignore[arg-type]
    stroke.strike()
    assert len(_connections_to(node.port)) == 3
    stroke.end()
    assert _connections_to(node.port) == []


def test_a_node_that_does_not_run_cannot_be_struck(node: Node) -> None:
    with pytest.raises(NotRunning, match="other does not run"):
        Sockets(node, Fault("s", SOCKETS, on="other", amount=3))  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["9:x:/\n8:cpu,pids:/a/b\n0::/\n", "3:pids:/a/b\n"])
def test_the_group_that_limits_threads_is_found(text: str) -> None:
    assert pids_group(text) == "/a/b"


def test_a_machine_without_such_a_group_is_no_crash() -> None:
    with pytest.raises(LookupError, match="no control group"):
        pids_group("0::/\n")


def _connections_to(port: int) -> List[int]:
    """Descriptors of this process that are connected to a port."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        try:
            with socket.socket(fileno=os.dup(int(name))) as each:
                if each.family == socket.AF_INET and each.getpeername()[1] == port:
                    found.append(int(name))
        except OSError:
            continue
    return found
