# SPDX-License-Identifier: Apache-2.0
"""Connections that ask nothing are closed; those of pages stay. The page stays small."""

import asyncio
import socket
import time
from pathlib import Path
from typing import Iterator
from urllib.parse import urlsplit

import aiohttp
import pytest
from served import TOKEN, WEB, Served

from merlin_monitor.access.web_access import TOKEN_HEADER
from merlin_monitor.web import connections as limits
from merlin_monitor.web import live_feed, web_server
from merlin_test import LONG

pytestmark = pytest.mark.processes

MANY = 100
LARGEST = 210_000  # bytes of the page, with all languages and a line for the licence in each file


@pytest.fixture
def hasty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Served]:
    """A server whose limits are short, but that for a first request: a test may be slow, too."""
    monkeypatch.setattr(web_server, "NEXT_REQUEST", 1)
    monkeypatch.setattr(limits, "BODY", 0.5)
    monkeypatch.setattr(limits, "LOOK", 0.1)
    served = Served(tmp_path, TOKEN)
    yield served
    served.stop()


def connect(served: Served, said: bytes = b"") -> socket.socket:
    where = urlsplit(served.url)
    found = socket.create_connection((where.hostname, where.port), LONG)
    found.sendall(said)
    return found


def all_of(connection: socket.socket) -> bytes:
    """What comes until the server closes; an error when it never does."""
    parts = []
    while True:
        try:
            part = connection.recv(65536)
        except ConnectionResetError:
            part = b""
        if not part:
            connection.close()
            return b"".join(parts)
        parts.append(part)


def established(served: Served) -> int:
    """Connections that the server has open, as the kernel knows them."""
    port = f":{urlsplit(served.url).port:04X}"
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return sum(1 for row in rows if row[1].endswith(port) and row[3] == "01")


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: 127.0"], ids=["nothing", "half a head"])
def test_many_connections_without_a_request_are_closed(
    hasty: Served, monkeypatch: pytest.MonkeyPatch, said: bytes
) -> None:
    monkeypatch.setattr(limits, "FIRST_REQUEST", 0.6)
    connections = [connect(hasty, said) for _ in range(MANY)]
    for connection in connections:
        assert b"200 OK" not in all_of(connection)


def test_a_connection_is_closed_some_time_after_its_answer(hasty: Served) -> None:
    host = urlsplit(hasty.url).netloc.encode()
    whole = connect(hasty, b"GET /keys.js HTTP/1.1\r\nHost: " + host + b"\r\n\r\n")
    assert all_of(whole).startswith(b"HTTP/1.1 200 OK")


def test_a_request_without_its_end_is_answered_and_closed(hasty: Served) -> None:
    head = f"POST /control/who HTTP/1.1\r\nHost: {urlsplit(hasty.url).netloc}\r\n{TOKEN_HEADER}: {TOKEN}\r\n"
    answer = all_of(connect(hasty, f"{head}Content-Length: 40\r\n\r\n{{".encode()))
    assert answer.startswith(b"HTTP/1.1 408 ") and b"The request did not end." in answer


def test_a_page_is_not_closed(hasty: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    async def follow() -> int:
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{hasty.url}live") as page:
            monkeypatch.setattr(limits, "FIRST_REQUEST", 0.6)
            others = [connect(hasty) for _ in range(3)]  # closed while the page is not
            for other in others:
                await asyncio.get_running_loop().run_in_executor(None, all_of, other)
            hasty.state.tree.set("now", "doing", "still here")
            while True:
                message = await asyncio.wait_for(page.receive(), LONG)
                assert message.type == aiohttp.WSMsgType.TEXT, message
                if "still here" in message.data:
                    return 1

    assert asyncio.run(follow()) == 1


def test_the_page_is_small() -> None:
    sizes = {path.relative_to(WEB): path.stat().st_size for path in WEB.rglob("*") if path.is_file()}
    assert sum(sizes.values()) <= LARGEST, sorted(sizes.items(), key=lambda item: -item[1])[:5]


def test_a_page_that_reads_nothing_any_more_is_closed(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_feed, "SEND_LIMIT", 0.5)
    host = urlsplit(served.url).netloc
    page = connect(
        served,
        f"GET /live HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode(),
    )
    assert page.recv(12) == b"HTTP/1.1 101"
    assert established(served) == 1
    number = 0
    while established(served):
        number += 1
        for fact in range(100):  # long texts are cut
            served.state.tree.set("knowledge", "facts", f"(fact {fact})", {"at": number, "x": "x" * 8000})
        time.sleep(0.05)  # a frame
    page.close()
