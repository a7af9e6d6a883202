# SPDX-License-Identifier: Apache-2.0
"""What the page asks of the history: events, and of the past runs, marks and segments of what was shown."""

import asyncio
import json
import math
from typing import Any, Callable, Tuple

from aiohttp import web

from merlin_monitor.history.event_log import Neighbour

COMPRESSED = 64 * 1024  # characters from when an answer is compressed
LARGEST_NUMBER = 2**62


class PastRoutes:
    """Answers with events, and below ``/past``.

    :param history: returns the history; raises HistoryError when none is kept.
    """

    def __init__(self, history: Callable[[], Any]) -> None:
        self._history = history

    def add_to(self, routes: web.UrlDispatcher) -> None:
        """Adds the addresses."""
        routes.add_get("/history", self._page)
        routes.add_get("/history.json", self._export)
        routes.add_get("/past/runs", self._runs)
        routes.add_get("/past/marks", self._marks)
        routes.add_get("/past/event", self._event)
        routes.add_get("/past/segment", self._segment)

    async def _page(self, request: web.Request) -> web.StreamResponse:
        before = _number(request, "before") if "before" in request.query else None
        limit = _number(request, "limit", "200")
        events = self._history().page(before, limit, _words(request, "kinds"))
        return web.json_response(await asyncio.wrap_future(events))

    async def _export(self, request: web.Request) -> web.StreamResponse:
        events = await asyncio.wrap_future(self._history().export())
        headers = {"Content-Disposition": 'attachment; filename="merlin-history.json"'}
        loop = asyncio.get_running_loop()
        text = await loop.run_in_executor(None, lambda: json.dumps(events, indent=1))
        return web.Response(text=text, content_type="application/json", headers=headers)

    async def _runs(self, request: web.Request) -> web.StreamResponse:
        return web.json_response(await asyncio.wrap_future(self._history().runs()))

    async def _marks(self, request: web.Request) -> web.StreamResponse:
        marks = await asyncio.wrap_future(self._history().marks(_number(request, "run")))
        return web.json_response(marks)

    async def _event(self, request: web.Request) -> web.StreamResponse:
        wanted = Neighbour(
            _number(request, "run"),
            _seconds(request, "wall"),
            _number(request, "id", "0"),
            request.query.get("back") is None,
            _words(request, "kinds"),
            _words(request, "marks"),
        )
        return web.json_response(await asyncio.wrap_future(self._history().neighbour(wanted)))

    async def _segment(self, request: web.Request) -> web.StreamResponse:
        run, wall = _number(request, "run"), _seconds(request, "wall")
        text = await asyncio.wrap_future(self._history().segment(run, wall))
        if text is None:
            raise web.HTTPNotFound(text="Of this run is not known what was shown.\n")
        response = web.Response(text=text, content_type="application/json")
        if len(text) > COMPRESSED and request.remote not in (
            "127.0.0.1",
            "::1",
        ):  # to pack takes longer than to send
            response.enable_compression()
        return response


def _number(request: web.Request, name: str, default: str = "") -> int:
    try:
        number = int(request.query.get(name, default))
    except ValueError:
        number = -1
    if not 0 <= number < LARGEST_NUMBER:
        raise web.HTTPBadRequest(text=f"{name} is a whole number.\n")
    return number


def _seconds(request: web.Request, name: str) -> float:
    try:
        seconds = float(request.query.get(name, ""))
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise web.HTTPBadRequest(text=f"{name} is a time in s since 1970.\n")
    return seconds


def _words(request: web.Request, name: str) -> Tuple[str, ...]:
    return tuple(word for word in request.query.get(name, "").split(",") if word)[:20]
