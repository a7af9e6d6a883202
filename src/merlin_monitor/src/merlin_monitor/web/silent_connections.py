# SPDX-License-Identifier: Apache-2.0
"""Closes connections without requests, so that one client cannot hold many of them open."""

import asyncio
from typing import Any, Dict

from aiohttp import web

FIRST_REQUEST = 15.0  # s from the connection to the end of its first request's head
NEXT_REQUEST = 15  # s between two requests
BODY = 15.0  # s from a request's head to the end of its body
LOOK = 5.0  # s of wall time between two looks; aiohttp has no limit for the first request


class SilentConnections:
    """Watches the connections of a server, in its loop.

    A connection that has asked once is aiohttp's: it closes it `NEXT_REQUEST` after the last answer.
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
