# SPDX-License-Identifier: Apache-2.0
"""Asks a node over connections of one's own, each with a limit: no library of ROS helps, and none can wait.

The limit counts the ticks of the process that asks: what it did not run itself does not make a node late.
"""

import select
import socket
import struct
import time
import xmlrpc.client
from http.client import HTTPConnection, HTTPException
from typing import Any, Callable, Dict
from urllib.parse import urlsplit

CALLER = "/chaos_witness"
#: s between two looks at a connection, and the most that one look counts.
LOOK, MOST = 0.01, 0.05
_LENGTH = struct.Struct("<I")


class Unanswered(Exception):
    """What was asked is not answered; the text says what came instead."""


class Ticks:
    """Counts a limit in looks of this process.

    :param limit: s.
    """

    def __init__(self, limit: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.limit = limit
        self.spent = 0.0
        """s that have passed, by the looks."""
        self._clock = clock
        self._last = clock()

    def look(self) -> bool:
        """Counts what has passed since the last look; False: the limit is reached."""
        now = self._clock()
        self.spent += min(now - self._last, MOST)
        self._last = now
        return self.spent < self.limit


class Service:
    """A service that a master has named.

    :param name: of it, global.
    :param uri: where it is, rosrpc://host:port.
    """

    def __init__(self, name: str, uri: str) -> None:
        self.name = name
        parts = urlsplit(uri)
        self.address = (str(parts.hostname), int(parts.port or 0))

    def ask(self, ticks: Ticks, request: bytes = b"") -> bytes:
        """Calls it on a connection that is made for it, and returns the response as it comes.

        :raises Unanswered: it does not answer, or says that the call failed.
        """
        with socket.socket() as connection:
            connection.setblocking(False)
            connection.connect_ex(self.address)
            self._await(connection, ticks, writing=True)
            if connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                raise Unanswered(f"{self.name}: its node takes no connection")
            fields = {"callerid": CALLER, "md5sum": "*", "service": self.name}
            connection.sendall(header(fields))
            self._read(connection, ticks, _LENGTH.unpack(self._read(connection, ticks, 4))[0])
            connection.sendall(_LENGTH.pack(len(request)) + request)
            good = self._read(connection, ticks, 1) != b"\0"
            response = self._read(connection, ticks, _LENGTH.unpack(self._read(connection, ticks, 4))[0])
        if not good:
            raise Unanswered(f"{self.name} failed: {response.decode(errors='replace')}")
        return response

    def _read(self, connection: socket.socket, ticks: Ticks, size: int) -> bytes:
        found = b""
        while len(found) < size:
            self._await(connection, ticks)
            try:
                part = connection.recv(size - len(found))
            except OSError as error:
                raise Unanswered(f"{self.name}: {error.strerror}") from error
            if not part:
                raise Unanswered(f"{self.name}: its node closes the connection")
            found += part
        return found

    def _await(self, connection: socket.socket, ticks: Ticks, writing: bool = False) -> None:
        reads, writes = ([], [connection]) if writing else ([connection], [])
        while not any(select.select(reads, writes, [], LOOK)):
            if not ticks.look():
                raise Unanswered(f"{self.name}: no answer within {ticks.limit:g} s")
        ticks.look()


def header(fields: Dict[str, str]) -> bytes:
    """The header of a connection."""
    texts = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(_LENGTH.pack(len(text)) + text for text in texts)
    return _LENGTH.pack(len(body)) + body


def ask_api(uri: str, limit: float, method: str, *arguments: Any) -> Any:
    """What a master or a node answers on its XML-RPC port.

    :param limit: s for each step of the call.
    :raises Unanswered: it does not answer, or refuses.
    """
    try:
        with xmlrpc.client.ServerProxy(uri, transport=_Bounded(limit)) as server:
            code, words, value = getattr(server, method)(CALLER, *arguments)
    except (OSError, HTTPException, xmlrpc.client.Error, ValueError) as error:
        raise Unanswered(f"{uri} {method}: {error}") from error
    if code != 1:
        raise Unanswered(f"{uri} {method}: {words}")
    return value


class _Bounded(xmlrpc.client.Transport):
    def __init__(self, limit: float) -> None:
        super().__init__()
        self._limit = limit

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = self._limit
        return connection
