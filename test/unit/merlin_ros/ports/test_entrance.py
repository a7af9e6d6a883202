# SPDX-License-Identifier: Apache-2.0
"""Connections that say nothing, or half of it, keep nobody out, and end."""

import contextlib
import errno
import socket
import struct
import threading
from typing import Any, Iterator, List

import pytest

from merlin_ros.ports import entrance, tcpros_port, xmlrpc_port
from merlin_test import LONG

GREETING = struct.pack("<I", 5) + b"hello"
REQUEST = b"POST / HTTP/1.1\r\nContent-Length: 4\r\n\r\nbody"


class Port:
    """A listening socket with an entrance, and who was greeted."""

    def __init__(self, length: Any = tcpros_port.greeting_length) -> None:
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.address = self.listening.getsockname()
        self.greeted: List[socket.socket] = []
        self.came = threading.Semaphore(0)
        self.entrance = entrance.Entrance(self.listening, "test", length, self._greet)
        self.thread = threading.Thread(target=self.entrance.run, daemon=True)
        self.thread.start()

    def _greet(self, connection: socket.socket, _: Any) -> None:
        self.greeted.append(connection)
        self.came.release()

    def connect(self, said: bytes = b"") -> socket.socket:
        client = socket.create_connection(self.address, LONG)
        client.sendall(said)
        return client

    def close(self) -> None:
        self.entrance.close()
        self.thread.join(LONG)
        assert not self.thread.is_alive()


@pytest.fixture
def port(request: Any) -> Iterator[Port]:
    made = Port(*([request.param] if hasattr(request, "param") else []))
    yield made
    made.close()


def is_greeted(port: Port, client: socket.socket) -> bool:
    if not port.came.acquire(timeout=LONG):
        return False
    return port.greeted[-1].getpeername() == client.getsockname()


def is_closed(client: socket.socket) -> bool:
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


@pytest.mark.parametrize(
    ("port", "said"),
    [(tcpros_port.greeting_length, GREETING), (xmlrpc_port.request_length, REQUEST)],
    indirect=["port"],
)
def test_what_comes_in_pieces_is_handed_on_whole_and_unread(port: Port, said: bytes) -> None:
    with port.connect() as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in said:
            client.sendall(bytes([byte]))
        assert is_greeted(port, client)
        assert port.greeted[0].recv(1000) == said
        assert port.greeted[0].gettimeout() is None


def test_a_client_that_closes_its_side_behind_its_greeting_is_greeted(port: Port) -> None:
    with port.connect(GREETING) as client:
        client.shutdown(socket.SHUT_WR)
        assert is_greeted(port, client)


def test_a_long_greeting_is_greeted(port: Port) -> None:
    said = struct.pack("<I", 60_000) + bytes(60_000)
    with port.connect(said) as client:
        assert is_greeted(port, client)


@pytest.mark.parametrize("digits", [b"900000", b"9" * 5000])
@pytest.mark.parametrize("port", [xmlrpc_port.request_length], indirect=True)
def test_a_request_that_is_longer_than_all_that_is_waited_for_is_handed_on(port: Port, digits: bytes) -> None:
    with port.connect(b"POST / HTTP/1.1\r\ncontent-length: %s\r\n\r\n" % digits) as client:
        assert is_greeted(port, client)


def _length_of_a_number(said: bytes) -> int:
    return int(said)


@pytest.mark.parametrize("port", [_length_of_a_number], indirect=True)
def test_words_that_cannot_be_read_end_their_connection_alone(port: Port) -> None:
    with port.connect(b"nonsense") as client:
        assert is_closed(client)
    with port.connect(b"1") as client:
        assert is_greeted(port, client)


def test_silent_connections_keep_nobody_out_and_use_no_thread(port: Port) -> None:
    threads = threading.active_count()
    silent = [port.connect(GREETING[: number % 5]) for number in range(entrance.MOST_SILENT // 2)]
    with port.connect(GREETING) as client:
        assert is_greeted(port, client)
    assert threading.active_count() <= threads + 1  # which greets the one
    for client in silent:
        client.close()


def test_the_oldest_silent_connection_is_closed_for_a_new_one(port: Port) -> None:
    silent = [port.connect() for _ in range(entrance.MOST_SILENT + 1)]
    assert silent[0].recv(1) == b""
    silent[-1].sendall(GREETING)
    assert is_greeted(port, silent[-1])
    for client in silent:
        client.close()


@pytest.mark.parametrize("said", [b"", GREETING[:2], GREETING[:-1]])
def test_half_a_greeting_ends_the_connection(monkeypatch: Any, port: Port, said: bytes) -> None:
    monkeypatch.setattr(entrance, "STALLED", 0.1)
    monkeypatch.setattr(entrance, "LOOK", 0.1)
    with port.connect(said) as client:
        assert is_closed(client)
    assert not port.greeted


def test_a_silence_behind_the_greeting_is_no_fault(monkeypatch: Any, port: Port) -> None:
    with port.connect(GREETING) as client, port.connect() as other:
        assert is_greeted(port, client)
        monkeypatch.setattr(entrance, "STALLED", 0.1)  # not before: this test may come late with the greeting
        monkeypatch.setattr(entrance, "LOOK", 0.1)
        assert other.recv(1) == b""  # its time was over after that of the first
        port.greeted[0].sendall(b"still here")
        assert client.recv(100) == b"still here"


@pytest.mark.parametrize(
    ("port", "said"),
    [(tcpros_port.greeting_length, struct.pack("<I", 2**31)), (xmlrpc_port.request_length, b"x" * 70_000)],
    indirect=["port"],
)
def test_a_greeting_without_end_is_not_waited_for(port: Port, said: bytes) -> None:
    with port.connect() as client:
        with contextlib.suppress(ConnectionError):
            client.sendall(said)
        assert is_closed(client)
    assert not port.greeted


def test_a_closed_entrance_takes_nobody_and_closes_who_waits(port: Port) -> None:
    with port.connect() as client, port.connect(GREETING) as other:
        assert is_greeted(port, other)  # and so the first one waits
        port.close()
        assert client.recv(1) == b""
    with pytest.raises(OSError) as refused:
        port.connect()
    assert refused.value.errno == errno.ECONNREFUSED
