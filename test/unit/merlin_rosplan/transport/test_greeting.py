"""Connections are greeted for a limited time, and are the server's own from then on."""

import socket
import struct
import threading

import pytest

from merlin_rosplan.transport import service_server

LONG = 60.0
GREETING = struct.pack("<I", 5) + b"hello"


@pytest.fixture
def pair():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        with socket.create_connection(listening.getsockname(), LONG) as client:
            server, address = listening.accept()
            with server:
                yield client, server, address


def greeted(pair, greet=None):
    """Greets the server's side; an event that is set when that has ended, and what came in the greeting."""
    _, server, address = pair
    ended, came = threading.Event(), []

    def read(connection, _):
        came.append(connection.recv(100))
        if greet is not None:
            greet(connection)

    greeter = service_server._Greeter(read)

    def run():
        greeter._run(server, address)
        ended.set()

    threading.Thread(target=run, daemon=True).start()
    return ended, came


def test_a_greeting_that_comes_in_pieces_is_read_whole(pair):
    client, server, _ = pair
    ended, came = greeted(pair)
    for byte in GREETING:
        client.sendall(bytes([byte]))
    assert ended.wait(LONG)
    assert came == [GREETING]
    assert server.gettimeout() is None


def test_a_time_out_that_the_service_sets_while_it_is_greeted_stays(pair):
    client, server, _ = pair
    ended, _ = greeted(pair, lambda connection: connection.settimeout(0.5))
    client.sendall(GREETING)
    assert ended.wait(LONG)
    assert server.gettimeout() == 0.5


def test_a_silence_after_the_greeting_is_no_fault(pair, monkeypatch):
    monkeypatch.setattr(service_server, "STALLED", 1.0)
    client, server, _ = pair
    client.sendall(GREETING)  # before the time begins in which it has to come
    ended, _ = greeted(pair)
    assert ended.wait(LONG)
    limit = server.getsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, 16)
    assert limit == bytes(16), "the kernel no longer ends its waits"


@pytest.mark.parametrize("said", [b"", GREETING[:2], GREETING[:-1]])
def test_half_a_greeting_ends_the_connection(pair, monkeypatch, said):
    monkeypatch.setattr(service_server, "STALLED", 1.0)
    client, server, _ = pair
    ended, came = greeted(pair)
    client.sendall(said)
    assert ended.wait(LONG)
    assert not came and server.fileno() == -1


def test_a_greeting_without_end_is_not_read(pair):
    client, server, _ = pair
    ended, came = greeted(pair)
    client.sendall(struct.pack("<I", 2**31))
    assert ended.wait(LONG)
    assert not came and server.fileno() == -1
