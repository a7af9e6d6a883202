# SPDX-License-Identifier: Apache-2.0
"""The master of a run: each node hears of what is new at once and in order, whatever the others do."""

import queue
import socket
import sys
import threading
import time
import traceback
import xmlrpc.client
from contextlib import ExitStack
from typing import Any, Iterator, List, Optional
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from merlin.local_names import master_uri
from merlin.master import Master
from merlin_test import LONG

TOPIC, KIND = "/news", "std_msgs/String"
HUNG = 8


class Node:
    """A node that notes what the master has said."""

    def __init__(self) -> None:
        self.heard: queue.Queue[Any] = queue.Queue()
        self._server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        self._server.register_function(self._update, "publisherUpdate")
        self._server.register_function(self._update, "paramUpdate")
        self._server.register_function(self._shut_down, "shutdown")
        self.uri = address_of(self._server.socket)
        self._thread = threading.Thread(target=self._server.serve_forever, name="node")
        self._thread.start()

    def _update(self, caller: str, name: str, value: Any) -> List[Any]:
        assert caller == "/master" and name.strip("/") == "news"
        self.heard.put(value)
        return [1, "", 0]

    def _shut_down(self, caller: str, why: str) -> List[Any]:
        self.heard.put(why)
        return [1, "", 0]

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join(LONG)
        self._server.server_close()


def address_of(listening: socket.socket) -> str:
    return f"http://127.0.0.1:{listening.getsockname()[1]}/"


@pytest.fixture
def api() -> Iterator[Any]:
    master = Master()
    with xmlrpc.client.ServerProxy(master_uri(master.port)) as proxy:
        yield proxy
    master.stop()


@pytest.fixture
def node() -> Iterator[Node]:
    made = Node()
    yield made
    made.close()


def test_nodes_that_hang_keep_no_other_one_from_a_new_publisher(api: Any, node: Node) -> None:
    with ExitStack() as stack:
        for number in range(HUNG):  # takes calls, and answers none
            hung = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            api.registerSubscriber(f"/hung_{number}", TOPIC, KIND, address_of(hung))
        api.registerSubscriber("/listener", TOPIC, KIND, node.uri)
        api.registerPublisher("/talker", TOPIC, KIND, "http://127.0.0.1:1/")
        assert node.heard.get(timeout=LONG) == ["http://127.0.0.1:1/"]


def test_a_node_hears_of_all_publishers_in_order_and_after_one_that_has_ended(api: Any, node: Node) -> None:
    with socket.create_server(("127.0.0.1", 0)) as ended:
        api.registerSubscriber("/ended", TOPIC, KIND, address_of(ended))
    api.registerSubscriber("/listener", TOPIC, KIND, node.uri)
    talkers = [f"http://127.0.0.1:{number}/" for number in range(1, 30)]
    for number, talker in enumerate(talkers):
        api.registerPublisher(f"/talker_{number}", TOPIC, KIND, talker)
    for number in range(len(talkers)):
        assert sorted(node.heard.get(timeout=LONG)) == sorted(talkers[: number + 1])


def test_a_node_hears_of_a_parameter_and_of_its_successor(api: Any, node: Node) -> None:
    api.subscribeParam("/listener", node.uri, TOPIC)
    api.setParam("/talker", TOPIC, 7)
    assert node.heard.get(timeout=LONG) == 7
    api.registerSubscriber("/listener", TOPIC, KIND, node.uri)
    api.registerSubscriber("/listener", TOPIC, KIND, "http://127.0.0.1:1/")
    assert "new node registered with same name" in node.heard.get(timeout=LONG)


def serving() -> int:
    """How many threads serve a port of XML-RPC; threading does not know all of them, nor when they end."""
    found = 0
    for frame in sys._current_frames().values():
        files = [each.f_code.co_filename for each, _ in traceback.walk_stack(frame)]
        found += any(file.endswith(("rosgraph/xmlrpc.py", "merlin_ros/ports/entrance.py")) for file in files)
    return found


def test_the_threads_of_masters_that_were_stopped_end() -> None:
    before = serving()
    for _ in range(30):
        Master().stop()
    end = time.monotonic() + LONG
    while serving() > before:
        assert time.monotonic() < end, "a thread works on, or waits for ever"
        time.sleep(0.01)


class _Stalled(threading.Event):
    """The first wait with a limit ends when the limit has passed, and nothing has happened meanwhile."""

    stalled = False

    def wait(self, timeout: Optional[float] = None) -> bool:
        if timeout is None or self.stalled:
            return super().wait(timeout)
        self.stalled = True
        return False


def test_a_stall_while_the_master_begins_is_no_reason_to_refuse_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread that opens its port has stood still for as long as the one that waits."""
    with monkeypatch.context() as while_it_begins:
        while_it_begins.setattr(threading, "Event", _Stalled)
        master = Master()
    with xmlrpc.client.ServerProxy(master_uri(master.port)) as api:
        assert api.getPid("/test")[0] == 1  # type: ignore[index]
    master.stop()
