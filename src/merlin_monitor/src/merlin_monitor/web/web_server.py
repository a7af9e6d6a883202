# SPDX-License-Identifier: Apache-2.0
"""The web server: the page, its live feed, the map's picture, the history and the control of the robot."""

import asyncio
import concurrent.futures
import functools
import json
import logging
import math
import os
import socket
import ssl
import threading
import time
from pathlib import Path
from typing import Any, Awaitable, Callable, Dict, Optional, Protocol, Tuple

import rospkg
from aiohttp import web

from merlin_monitor.access.web_access import (
    HEADERS,
    READ_ONLY,
    TOKEN_HEADER,
    RequestRefused,
    WebAccess,
    WrongToken,
    WrongTokens,
)
from merlin_monitor.history.event_log import Neighbour
from merlin_monitor.history.history_reader import HistoryReader
from merlin_monitor.history.pictures import Pictures
from merlin_monitor.state.history_events import Event, sentence
from merlin_monitor.state.history_store import HistoryError
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import say
from merlin_monitor.web.connections import ServerError, SilentConnections, body_of, listen
from merlin_monitor.web.live_feed import LiveFeed
from merlin_monitor.web.page_control import ControlError, Controls
from merlin_ros.work.threads import start_thread

FILES = (".html", ".css", ".js", ".json", ".svg")
GOODBYE = 0.5  # s for a page to answer when it is closed
CUT_OFF = 0.3  # s for what was cancelled to end
PING = 20.0  # s between two signs of life of a page
OLD_CHECK = 1.5  # s since the model's last check, after which it counts as hung
LONGEST_REQUEST = 64 * 1024  # bytes
NEXT_REQUEST = 15  # s between two requests of a connection
COMPRESSED = 64 * 1024  # characters of an answer from when it is compressed, but for this machine
LARGEST_NUMBER = 2**62
AT_ONCE = 50  # requests, and as many stops, that are carried out; others wait
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Shown(Protocol):
    """A :class:`MonitorModel`, an :class:`Archive`, or a fleet."""

    tree: StateTree
    pictures: Pictures

    @property
    def history(self) -> Optional[HistoryReader]:
        """Events, and what was shown; None: none is kept."""

    @property
    def checked_at(self) -> float:
        """When what is shown was checked last, s of ``time.monotonic``."""

    def report(self, event: Event) -> None:
        """Adds an event to the history."""


class WebServer:
    """Serves the page in a thread of its own.

    :param state: what is shown.
    :param access: which requests are served.
    :param control: of the robot; None: it is only shown.
    :param host: address to listen on.
    :param port: wanted; if it is taken, the next free one. 0: any free one.
    :param scripts: of the panels, by their names; later ones may be added to it.
    :param tls: certificate and key; None: without encryption.
    :raises ServerError: it cannot listen.
    """

    def __init__(
        self,
        state: Shown,
        access: WebAccess,
        control: Optional[Controls] = None,
        host: str = "127.0.0.1",
        port: int = 0,
        scripts: Optional[Dict[str, Path]] = None,
        tls: Optional[ssl.SSLContext] = None,
    ) -> None:
        self._state = state
        self._folder = Path(rospkg.RosPack().get_path("merlin_monitor")) / "web"
        self._access = access
        self._control = control
        self._scripts: Dict[str, Path] = scripts if scripts is not None else {}
        self._tls = tls
        self._wrong_tokens = WrongTokens(self._report_wrong_tokens)
        self._socket = listen(host, port)
        self.port: int = self._socket.getsockname()[1]
        shown = host if host not in ("", "0.0.0.0", "::") else socket.gethostname()
        self.address = (
            f"{'https' if tls else 'http'}://{f'[{shown}]' if ':' in shown else shown}:{self.port}/"
        )
        self._live = LiveFeed(
            state.tree, lambda: time.monotonic() - state.checked_at < OLD_CHECK, self._shown_to_visitors
        )
        # What a page is made of, and what has its own rules; all else is what the robot does.
        self._for_visitors = (
            *(self._index, self._serve_file, self._serve_panel),
            *(self._serve_live, self._may_follow, self._serve_control),
        )
        self._silent = SilentConnections()
        self._loop = asyncio.new_event_loop()
        self._started = threading.Event()
        self._failed = ""
        self._stop: Optional[asyncio.Event] = None
        self._room: Dict[bool, asyncio.Semaphore] = {}  # of stops, and of all else
        self._thread = threading.Thread(target=self._work, name="web server", daemon=True)

    def start(self) -> None:
        """Begins to serve.

        :raises ServerError: it could not.
        """
        self._thread.start()
        if not self._started.wait(10.0) or self._failed:
            raise ServerError(self._failed or "the web server did not start within 10 s")

    def stop(self) -> None:
        """Closes all pages and ends."""
        if self._thread.is_alive() and self._stop is not None:
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(1.5)

    def application(self) -> web.Application:
        """Makes the application of aiohttp with all routes."""
        application = web.Application(middlewares=[self._guard], client_max_size=LONGEST_REQUEST)
        routes = application.router
        routes.add_get("/", self._index)
        routes.add_get("/live", self._serve_live)
        routes.add_post("/live", self._may_follow)
        routes.add_get("/state.json", self._serve_state)
        routes.add_get("/map.png", self._serve_picture)
        routes.add_get("/pictures/{name}.png", self._serve_picture)
        routes.add_post("/control/{what}", self._serve_control)
        routes.add_get("/panels/{name}.js", self._serve_panel)
        routes.add_get("/history", self._page)
        routes.add_get("/history.json", self._export)
        routes.add_get("/past/runs", self._runs)
        routes.add_get("/past/marks", self._marks)
        routes.add_get("/past/event", self._event)
        routes.add_get("/past/segment", self._segment)
        routes.add_get("/{name}", self._serve_file)
        return application

    def _work(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as error:  # reported to the thread that waits for the start
            self._failed = f"the web server failed: {type(error).__name__}: {error}"
        finally:
            self._started.set()
            self._end_tasks()
            self._loop.close()

    def _end_tasks(self) -> None:
        left = asyncio.all_tasks(self._loop)
        for task in left:
            task.cancel()
        if left:
            self._loop.run_until_complete(asyncio.wait(left, timeout=CUT_OFF))

    async def _serve(self) -> None:
        self._stop = asyncio.Event()
        self._room = {stop: asyncio.Semaphore(AT_ONCE) for stop in (False, True)}
        runner = web.AppRunner(self.application(), access_log=None, keepalive_timeout=NEXT_REQUEST)
        await runner.setup()
        await web.SockSite(runner, self._socket, shutdown_timeout=1.0, ssl_context=self._tls).start()
        watch = self._loop.create_task(self._silent.watch(runner))
        self._started.set()
        await self._stop.wait()
        watch.cancel()
        await self._live.close()
        await runner.cleanup()

    # --- requests ------------------------------------------------------------------------------------------

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        self._silent.heard(request)
        try:
            self._access.check_host(request.headers.get("Host"))
            if request.path == "/live" or request.method != "GET":
                self._access.check_origin(request.headers.get("Origin"), request.headers.get("Host"))
            if request.match_info.handler not in self._for_visitors and not self._may_look(request):
                raise RequestRefused(self._access.no_look)
            response = await handler(request)
        except RequestRefused as refused:
            response = web.Response(status=403, text=f"{refused}\n")
        except HistoryError as error:
            response = web.Response(status=503, text=f"{error}\n")
        except web.HTTPException as error:
            error.headers.update(HEADERS)
            raise
        except Exception as error:  # answered without a traceback, and with the headers
            logging.getLogger(__name__).exception("%s %s", request.method, request.path)
            response = web.Response(status=500, text=f"The monitor failed: {type(error).__name__}.\n")
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    def _may_look(self, request: web.Request) -> bool:
        return self._access.may_look(request.cookies)

    def _shown_to_visitors(self) -> Dict[str, Any]:
        """The state for one who may not look: what it takes to sign in, and to stop."""
        known = ("robot", "open_stop", "stops")
        meta = {name: self._state.tree.get("meta", name) for name in known}
        return {"visitor": self._access.no_look, "meta": {**meta, "control": self._access.has_operators}}

    # --- what is shown -------------------------------------------------------------------------------------

    async def _index(self, request: web.Request) -> web.StreamResponse:
        return web.FileResponse(self._folder / "index.html")

    async def _serve_file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        path = self._folder / name
        # Not Path.is_file, which raises for a name that is too long.
        if "/" in name or name.startswith(".") or path.suffix not in FILES or not os.path.isfile(path):
            raise web.HTTPNotFound(text=f"There is no {name}.\n")
        return web.FileResponse(path)

    async def _serve_panel(self, request: web.Request) -> web.StreamResponse:
        # A panel is asked for by its name, which leads to no other file.
        script = self._scripts.get(request.match_info["name"])
        if script is None or not script.is_file():
            raise web.HTTPNotFound(text="There is no such panel.\n")
        return web.FileResponse(script)

    async def _serve_live(self, request: web.Request) -> web.StreamResponse:
        response = web.WebSocketResponse(heartbeat=PING, timeout=GOODBYE, compress=False, max_msg_size=1024)
        if not response.can_prepare(request).ok:
            raise web.HTTPUpgradeRequired(text="This address takes WebSockets only.\n", headers=HEADERS)
        await response.prepare(request)
        assert request.transport is not None
        await self._live.serve(response, request.transport.abort, lambda: self._may_look(request))
        return response

    async def _may_follow(self, request: web.Request) -> web.StreamResponse:
        # For a page that gets no WebSocket, which browsers do not explain; what is refused is refused before.
        return web.Response(status=204)

    async def _serve_state(self, request: web.Request) -> web.StreamResponse:
        version, state = self._state.tree.as_json()
        text = f'{{"version":{version},"state":{state}}}'
        return web.Response(text=text, content_type="application/json")

    async def _serve_picture(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info.get("name", "map")
        version = request.query.get("version", "")
        picture = self._state.pictures.get(name, version)
        if picture is None and version and self._state.history is not None:
            picture = await asyncio.wrap_future(self._state.history.picture(name, version))
        if picture is None:
            raise web.HTTPNotFound(text="There is no such picture.\n")
        return web.Response(body=picture, content_type="image/png")

    # --- the past ------------------------------------------------------------------------------------------

    def _history(self) -> HistoryReader:
        if self._state.history is None:
            raise HistoryError("No history is kept; start the monitor with history:=<file>.")
        return self._state.history

    async def _page(self, request: web.Request) -> web.StreamResponse:
        before = _number(request, "before") if "before" in request.query else None
        limit = _number(request, "limit", "200")
        return await _answer(self._history().page(before, limit, _words(request, "kinds")))

    async def _export(self, request: web.Request) -> web.StreamResponse:
        events = await asyncio.wrap_future(self._history().export())
        headers = {"Content-Disposition": 'attachment; filename="merlin-history.json"'}
        loop = asyncio.get_running_loop()
        text = await loop.run_in_executor(None, lambda: json.dumps(events, indent=1))
        return web.Response(text=text, content_type="application/json", headers=headers)

    async def _runs(self, request: web.Request) -> web.StreamResponse:
        return await _answer(self._history().runs())

    async def _marks(self, request: web.Request) -> web.StreamResponse:
        return await _answer(self._history().marks(_number(request, "run")))

    async def _event(self, request: web.Request) -> web.StreamResponse:
        wanted = Neighbour(
            _number(request, "run"),
            _seconds(request, "wall"),
            _number(request, "id", "0"),
            request.query.get("back") is None,
            _words(request, "kinds"),
            _words(request, "marks"),
        )
        return await _answer(self._history().neighbour(wanted))

    async def _segment(self, request: web.Request) -> web.StreamResponse:
        run, wall = _number(request, "run"), _seconds(request, "wall")
        text = await asyncio.wrap_future(self._history().segment(run, wall))
        if text is None:
            raise web.HTTPNotFound(text="Of this run is not known what was shown.\n")
        response = web.Response(text=text, content_type="application/json")
        if len(text) > COMPRESSED and request.remote not in ("127.0.0.1", "::1"):
            response.enable_compression()
        return response

    # --- control -------------------------------------------------------------------------------------------

    async def _serve_control(self, request: web.Request) -> web.StreamResponse:
        what, address = request.match_info["what"], request.remote or "an unknown address"
        wrong = False
        try:
            by = self._access.operator(request.headers.get(TOKEN_HEADER))
        except RequestRefused as refused:
            wrong = isinstance(refused, WrongToken)
            if what != "stop" or not self._access.open_stop:
                if wrong:
                    await self._wrong_tokens.slow_down(address)
                raise
            by = f"a visitor at {address}"
        try:
            fields = json.loads(await body_of(request) or "{}")
            if not isinstance(fields, dict):
                raise ValueError("no object")
        except (ValueError, LookupError, RecursionError):
            return web.json_response({"error": "The request is not a JSON object."}, status=400)
        if what == "who":
            key = self._access.look_key(by)
            return web.json_response({"done": by, **({"look": key} if key else {})})
        control = self._control
        if control is None:
            raise RequestRefused(READ_ONLY)
        try:
            done = asyncio.ensure_future(self._carry_out(control, what, fields, by))
            if wrong:  # the robot stops at once; who tries tokens has to wait all the same
                await self._wrong_tokens.slow_down(address)
            said = await done
        except ControlError as error:
            return web.json_response({"error": str(error), "confirm": error.confirm}, status=409)
        return web.json_response(said)

    async def _carry_out(
        self, control: Controls, what: str, fields: Dict[str, Any], by: str
    ) -> Dict[str, Any]:
        """In a thread of its own: a stop does not wait for requests that wait for an answer."""
        async with self._room[what == "stop"]:
            call = functools.partial(control.carry_out, what, fields, by)
            return await asyncio.wrap_future(_in_thread(f"page: {what}", call))

    def _report_wrong_tokens(self, address: str, count: int) -> None:
        wrong = say("wrong token from {address}", address=address)
        said = say("{what}, {count} times", what=wrong, count=str(count)) if count > 1 else wrong
        event = sentence("control", said, self._state.tree.get("meta", "time") or 0.0)
        logging.getLogger(__name__).warning("%s", event.text)
        self._state.report(event)


async def _answer(future: "concurrent.futures.Future[Any]") -> web.Response:
    return web.json_response(await asyncio.wrap_future(future))


def _in_thread(name: str, call: Callable[[], Dict[str, Any]]) -> "concurrent.futures.Future[Dict[str, Any]]":
    done: concurrent.futures.Future[Dict[str, Any]] = concurrent.futures.Future()
    done.set_running_or_notify_cancel()

    def work() -> None:
        try:
            done.set_result(call())
        except BaseException as error:
            done.set_exception(error)

    start_thread(name, work)
    return done


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
