# SPDX-License-Identifier: Apache-2.0
"""Connections to a master end with the clients that made them."""

import errno
import gc
import socketserver
import threading
from types import SimpleNamespace
from typing import Any, Iterator, List
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest
import rosgraph
import rospy

from merlin_ros.master import master_link
from merlin_ros.master.master_link import bounded_master, bounded_proxy, get_param
from merlin_test import LONG

pytestmark = pytest.mark.everywhere

closed = threading.Event()
connections: List[Any] = []


class Handler(SimpleXMLRPCRequestHandler):
    """Keeps its connection until the client closes it, as a master does."""

    protocol_version = "HTTP/1.1"

    def setup(self) -> None:
        super().setup()
        connections.append(self.client_address)

    def finish(self) -> None:
        super().finish()
        closed.set()


class Server(socketserver.ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True


@pytest.fixture
def uri(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    closed.clear()
    connections.clear()
    with Server(("127.0.0.1", 0), Handler, logRequests=False) as server:
        server.register_function(lambda caller: [1, "", 42], "getPid")
        server.register_function(lambda caller, name: [1, "", name], "getParam")
        threading.Thread(target=server.serve_forever, name="master", daemon=True).start()
        address = f"http://127.0.0.1:{server.server_address[1]}"
        monkeypatch.setenv("ROS_MASTER_URI", address)
        yield address
        server.shutdown()


def ask_a_node(uri: str) -> Any:
    client = bounded_proxy(uri, LONG)
    client.getPid("/test")
    return client


def ask_the_master(uri: str) -> Any:
    client = bounded_master(LONG)
    client.getPid()
    return client


@pytest.mark.parametrize("ask", [ask_a_node, ask_the_master])
def test_a_dropped_client_closes_its_connection_at_once(uri: str, ask: Any) -> None:
    gc.disable()  # a quiet node's collector comes after minutes
    try:
        client = ask(uri)
        assert not closed.is_set()
        del client
        assert closed.wait(LONG)
    finally:
        gc.enable()


def test_parameters_are_asked_for_over_one_connection_whatever_thread_asks(
    uri: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(master_link, "bounded_master", lambda: bounded_master(LONG))
    assert get_param("/a") == "/a"
    thread = threading.Thread(target=get_param, args=("/b",))
    thread.start()
    thread.join()
    assert get_param("/c") == "/c"
    assert len(connections) == 1


def test_a_registration_is_noticed_when_it_is_noted_and_an_end_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    noted, waits = threading.Event(), threading.Event()
    woken: List[bool] = []

    def run(manager: Any) -> None:
        with manager.cond:
            waits.set()
            woken.append(manager.cond.wait(LONG))

    monkeypatch.setattr(rospy.core, "_shutdown_hooks", [])
    monkeypatch.setattr(master_link, "REGISTRATION_LOOK", 60.0)
    monkeypatch.setattr(master_link.RegManager, "run", run)
    monkeypatch.setattr(master_link.ROSHandler, "_is_registered", lambda handler: noted.is_set())
    master_link.hasten_registration()
    found: List[bool] = []
    waiting = threading.Thread(target=lambda: found.append(master_link.ROSHandler._is_registered(None)))
    waiting.start()
    noted.set()
    manager = SimpleNamespace(cond=threading.Condition())
    running = threading.Thread(target=master_link.RegManager.run, args=(manager,))
    running.start()
    waiting.join()
    assert found == [True]
    assert waits.wait(LONG)
    for hook in rospy.core._shutdown_hooks:
        hook("the test ends it")
    running.join()
    assert woken == [True]


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused"), "Connection refused"),
        (rosgraph.MasterException("no such node"), "no such node"),
        (OSError(), "OSError"),
    ],
)
def test_why_a_master_gave_no_answer_is_never_empty(error: Exception, reason: str) -> None:
    assert master_link.why_unasked("http://localhost:11311", error) == reason
