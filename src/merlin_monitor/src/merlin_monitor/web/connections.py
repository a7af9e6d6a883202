# SPDX-License-Identifier: Apache-2.0
"""Connections of a web server: where it listens, and how long one may ask nothing."""

import asyncio
import errno
import socket
from typing import Any, Dict, List, Optional

from aiohttp import web

PORTS_TRIED = 20  # from the wanted one on
DUAL = socket.has_dualstack_ipv6()  # :: is every address of IPv4, too
FIRST_REQUEST = 15.0  # s from the connection to the end of its first request's head
BODY = 15.0  # s from a request's head to the end of its body
LOOK = 5.0  # s of wall time between two looks; aiohttp has no limit for the first request


class ServerError(RuntimeError):
    """The page cannot be served; the text says why."""


def listen(host: str, port: int) -> socket.socket:
    """A listening socket on the port or, if others have it, the next free one.

    :raises ServerError: when none is free.
    """
    last: Optional[OSError] = None
    candidates: List[int] = [port] if port == 0 else list(range(port, min(port + PORTS_TRIED, 65536)))
    for candidate in candidates:
        try:
            addresses = socket.getaddrinfo(
                host or None, candidate, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
            )
        except (OSError, OverflowError) as error:
            raise ServerError(f"the address {host!r} cannot be used: {error}; correct host:=…") from error
        for family, _, _, _, address in addresses:
            try:
                return socket.create_server(
                    address, family=family, backlog=64, dualstack_ipv6=family == socket.AF_INET6 and DUAL
                )
            except OSError as error:
                last = error
                if error.errno == errno.EADDRINUSE:
                    break
            # The next address: localhost is ::1 first, also on a machine without IPv6.
        if isinstance(last, PermissionError):
            break
    raise ServerError(f"cannot listen on {host}:{port}: {last}; choose another port:=…")


class SilentConnections:
    """Watches the connections of a server, in its loop.

    A connection that has asked once is aiohttp's, which has a limit for the next request.
    """

    def __init__(self) -> None:
        self._waiting: Dict[Any, float] = {}  # connection → s of the loop's time when it was seen first
        self._asked: Dict[Any, None] = {}

    def heard(self, request: web.Request) -> None:
        """A connection has asked something."""
        self._asked[request.protocol] = None

    async def watch(self, runner: web.AppRunner) -> None:
        """Looks again and again, until it is cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(LOOK)
            server = runner.server
            there = list(server.connections) if server is not None else []
            self._asked = {each: None for each in there if each in self._asked}
            now = loop.time()
            silent = [each for each in there if each not in self._asked]
            self._waiting = {each: self._waiting.get(each, now) for each in silent}
            for connection, since in self._waiting.items():
                if now - since >= FIRST_REQUEST - LOOK:
                    connection.force_close()


async def body_of(request: web.Request) -> str:
    """The text of a request.

    :raises web.HTTPRequestTimeout: it does not come.
    """
    try:
        return await asyncio.wait_for(request.text(), BODY)
    except asyncio.TimeoutError:
        raise web.HTTPRequestTimeout(text="The request did not end.\n") from None
