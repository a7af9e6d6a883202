# SPDX-License-Identifier: Apache-2.0
"""A node that is short of descriptors or threads, or beset by silent clients, serves again, or ends."""

import contextlib
import socket
import xmlrpc.client
from typing import Any, Iterator, List
from urllib.parse import urlparse

import pytest

pytestmark = pytest.mark.processes

NOT_YET = 1  # exit code of a node that is started again

# A guard that takes all descriptors or threads of its process, and gives them back, as its input says.
GUARD = """
import os, resource, sys, threading
from merlin_ros.ports import self_check
self_check.PERIOD = 3600.0 if "patient" in sys.argv else 0.2
start = "_start_joinable_thread" if hasattr(threading, "_start_joinable_thread") else "_start_new_thread"
starts, taken, short = getattr(threading, start), [], threading.Event()

limits = resource.getrlimit(resource.RLIMIT_NOFILE)

def refuse_or_start(*args, **options):
    if short.is_set():
        raise RuntimeError("can't start new thread")
    return starts(*args, **options)

setattr(threading, start, refuse_or_start)

def obey():
    for line in sys.stdin:
        if line == "descriptors\\n":
            # Lower than those of connections: one that closes gives none back.
            resource.setrlimit(resource.RLIMIT_NOFILE, (8, limits[1]))
            try:
                while True:
                    taken.append(os.dup(0))
            except OSError:
                pass
        elif line == "threads\\n":
            short.set()
        elif line == "enough\\n":
            short.clear()
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
            while taken:
                os.close(taken.pop())
        print("OBEYED " + line, flush=True)

threading.Thread(target=obey, daemon=True).start()
from merlin_guard.guard_node import main
sys.exit(main())
"""


class Guard:
    """The guard of a test, and its two ports."""

    def __init__(self, master: Any, *args: str) -> None:
        self._master = master
        self.node = master.node(GUARD, *args)
        self.is_served()
        _, _, service = master.api.lookupService("/test", "/merlin/stop")
        self.topics_and_services = urlparse(service)
        self.api = urlparse(master.address_of("/merlin_guard"))

    def is_served(self) -> None:
        """Has the base stopped by a client that starts now, and reads a topic in it."""
        self._master.tool("rostopic", "echo", "-n", "1", "/merlin/guard").expect("state: ")
        call = self._master.tool("rosservice", "call", "--wait", "/merlin/stop")
        call.expect("success: True")

    def order(self, what: str) -> None:
        self.node.say(what)
        self.node.expect(f"OBEYED {what}")

    def ports(self) -> List[Any]:
        return [(where.hostname, where.port) for where in (self.topics_and_services, self.api)]


@pytest.fixture
def guard(master: Any) -> Guard:
    return Guard(master, "patient")


@pytest.fixture
def impatient(master: Any) -> Guard:
    return Guard(master)


@contextlib.contextmanager
def silent(address: Any, count: int) -> Iterator[None]:
    with contextlib.ExitStack() as open_ones:
        for _ in range(count):
            open_ones.enter_context(socket.create_connection(address, 60.0))
        yield


def test_a_guard_is_stopped_and_seen_while_silent_connections_are_open(guard: Guard) -> None:
    with contextlib.ExitStack() as open_ones:
        for port in guard.ports():
            open_ones.enter_context(silent(port, 20))
        guard.is_served()
    assert guard.node.end() == 0


def test_a_guard_serves_again_when_there_are_descriptors_again(guard: Guard) -> None:
    guard.order("descriptors")
    waiting = [socket.create_connection(port, 60.0) for port in guard.ports()]
    said = {guard.node.expect("a connection cannot be taken").split(":")[0][-6:] for _ in waiting}
    assert len(said) == 2, "each port says so once"
    guard.order("enough")
    guard.is_served()
    for connection in waiting:
        connection.close()
    assert guard.node.end() == 0
    assert guard.node.output.count("a connection cannot be taken") == 2
    assert "Traceback" not in guard.node.output


def test_a_guard_whose_descriptors_do_not_come_back_ends_to_be_started_again(impatient: Guard) -> None:
    impatient.order("descriptors")
    impatient.node.expect("the node ends, to be started again")
    assert impatient.node.ended() == NOT_YET
    assert "gives no answer" in impatient.node.output
    assert "Too many open files" in impatient.node.output


def test_a_guard_that_can_start_no_thread_ends_to_be_started_again(impatient: Guard) -> None:
    impatient.order("threads")
    impatient.node.expect("the node ends, to be started again")
    assert impatient.node.ended() == NOT_YET
    assert "gives no answer" in impatient.node.output
    assert "a connection cannot be taken: can't start new thread" in impatient.node.output


def test_a_node_that_can_start_no_thread_ends_when_it_is_told_to(guard: Guard) -> None:
    guard.order("threads")
    assert guard.node.end() == 0


def test_a_client_of_the_api_may_keep_its_connection(guard: Guard) -> None:
    node = xmlrpc.client.ServerProxy(guard.api.geturl())
    for _ in range(2):
        assert node.getPid("/test")[0] == 1
