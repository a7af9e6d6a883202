# SPDX-License-Identifier: Apache-2.0
"""Requests that cannot be written, or not be read; a service proxy that is closed."""

import socket
import struct
import threading
from typing import Any, Optional
from urllib.parse import urlparse

import pytest
import rosgraph
from std_srvs.srv import SetBool

from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceProxy
from merlin_test import LONG

pytestmark = pytest.mark.processes


SERVER = """
import sys, rospy
from std_srvs.srv import SetBool, SetBoolResponse
from merlin_ros.node import run_node

def start():
    start.service = rospy.Service("ask", SetBool, lambda request: SetBoolResponse(True, "told"))
    print("started", flush=True)
sys.exit(run_node("server", start))
"""

CLIENT = """
import sys
from std_srvs.srv import SetBool
from merlin_ros.node import run_node
from merlin_ros.service_proxy import ServiceProxy

ask = ServiceProxy("ask", SetBool, timeout=100.0)

def start():
    def run():
        for request in (True, "no truth", True):
            try:
                print("ANSWER", ask(request).message, flush=True)
            except Exception as error:
                print("ANSWER", type(error).__name__, flush=True)
    return run
sys.exit(run_node("client", start))
"""


def test_a_request_that_cannot_be_written_does_not_spoil_the_next_one(master: Any) -> None:
    master.node(SERVER).expect("started")
    client = master.node(CLIENT)
    answers = [client.expect("ANSWER") for _ in range(3)]
    assert answers == ["ANSWER told", "ANSWER SerializationError", "ANSWER told"]


def test_a_request_that_cannot_be_read_is_answered(master: Any) -> None:
    """Of any node, not of the planning system alone: rospy would leave its client waiting."""
    master.node(SERVER).expect("started")
    address = urlparse(rosgraph.Master("/client", master_uri=master.uri).lookupService("/ask"))
    fields = (b"service=/ask", b"md5sum=*", b"callerid=/client", b"persistent=1")
    greeting = b"".join(struct.pack("<I", len(field)) + field for field in fields)
    client = socket.create_connection((address.hostname, address.port), LONG)
    with client, client.makefile("rwb") as stream:
        stream.write(struct.pack("<I", len(greeting)) + greeting)
        stream.flush()
        (length,) = struct.unpack("<I", stream.read(4))
        stream.read(length)
        stream.write(struct.pack("<I", 0))  # a SetBool without its bool
        stream.flush()
        assert stream.read(1) == b"\0"
        (length,) = struct.unpack("<I", stream.read(4))
        assert b"cannot be read" in stream.read(length)
        assert stream.read(1) == b"", "it is not closed"


class Condition(threading.Condition):
    """Says that a thread waits."""

    def __init__(self) -> None:
        super().__init__()
        self.waits = threading.Event()

    def wait(self, timeout: Optional[float] = None) -> bool:
        self.waits.set()
        return super().wait(timeout)


def test_a_proxy_is_closed_between_two_calls_also_in_a_scope_that_has_ended() -> None:
    proxy, caller = ServiceProxy("ask", SetBool), CallScope()
    proxy._free = free = Condition()
    assert proxy._occupy(caller)

    def close() -> None:
        with CallScope() as scope:
            scope.ended = True
            proxy.close()

    thread = threading.Thread(target=close, daemon=True)
    thread.start()
    while thread.is_alive() and not free.waits.wait(0.01):
        pass
    assert proxy._user is caller, "closed under a call"
    proxy._leave()
    thread.join(LONG)
    assert proxy._user is None


def test_a_service_of_a_server_that_takes_no_connection_is_offered_all_the_same(
    master: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", master.uri)
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))  # and does not listen
        node = rosgraph.Master("/busy", master.uri)
        node.registerService(
            "/busy_one", f"rosrpc://127.0.0.1:{busy.getsockname()[1]}", "http://127.0.0.1:1/"
        )
        proxy = ServiceProxy("/busy_one", SetBool)
        assert not proxy.available() and proxy.offered()
        assert not ServiceProxy("/nobody", SetBool).offered()
