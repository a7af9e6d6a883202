# SPDX-License-Identifier: Apache-2.0
"""The witness's own way to ask a service: bounded, in its own ticks, and true about what came."""

import socket
import struct
import threading
from contextlib import contextmanager
from typing import Callable, Iterator, List

import pytest
from chaos.under_test.tcpros import Service, Ticks, Unanswered, header

from merlin_test import LONG

LENGTH = struct.Struct("<I")


@contextmanager
def server(answer: Callable[[socket.socket], None]) -> Iterator[Service]:
    """A node that takes one connection and does something with it."""
    with socket.create_server(("127.0.0.1", 0)) as door:

        def serve() -> None:
            connection, _ = door.accept()
            with connection:
                answer(connection)

        thread = threading.Thread(target=serve, name="node", daemon=True)
        thread.start()
        yield Service("/stop", f"rosrpc://127.0.0.1:{door.getsockname()[1]}")
        thread.join(LONG)


def block(connection: socket.socket) -> bytes:
    (size,) = LENGTH.unpack(connection.recv(4, socket.MSG_WAITALL))
    return connection.recv(size, socket.MSG_WAITALL)


def test_what_a_service_answers_comes_back() -> None:
    seen: List[bytes] = []

    def answer(connection: socket.socket) -> None:
        seen.append(block(connection))
        connection.sendall(header({"type": "std_srvs/Trigger"}))
        assert connection.recv(4, socket.MSG_WAITALL) == LENGTH.pack(0)
        connection.sendall(b"\1" + LENGTH.pack(3) + b"yes")

    with server(answer) as service:
        assert service.ask(Ticks(60.0)) == b"yes"
    assert b"service=/stop" in seen[0]


def test_a_node_that_does_not_greet_is_reported_as_such() -> None:
    over = threading.Event()
    with server(lambda connection: bool(over.wait(LONG)) and None) as service:
        ticks = Ticks(0.2)
        with pytest.raises(Unanswered, match="no answer within 0.2 s"):
            service.ask(ticks)
        over.set()
    assert ticks.spent >= 0.2


def test_a_call_that_failed_says_why() -> None:
    def answer(connection: socket.socket) -> None:
        block(connection)
        connection.sendall(header({}))
        connection.recv(4, socket.MSG_WAITALL)
        connection.sendall(b"\0" + LENGTH.pack(4) + b"oops")

    with server(answer) as service, pytest.raises(Unanswered, match="oops"):
        service.ask(Ticks(60.0))


def test_a_node_that_hangs_up_is_reported_as_such() -> None:
    with server(lambda connection: None) as service, pytest.raises(Unanswered):
        service.ask(Ticks(60.0))


def test_a_port_without_a_node_is_reported_as_such() -> None:
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = door.getsockname()[1]
    with pytest.raises(Unanswered, match="takes no connection"):
        Service("/stop", f"rosrpc://127.0.0.1:{port}").ask(Ticks(60.0))


def test_a_stall_of_the_one_who_asks_counts_as_one_look() -> None:
    now = [0.0]
    ticks = Ticks(0.5, lambda: now[0])
    now[0] = 60.0
    assert ticks.look()
    assert ticks.spent == pytest.approx(0.05)
