# SPDX-License-Identifier: Apache-2.0
"""The web server as browsers and others reach it: what is served, and how changes arrive."""

import asyncio
import contextlib
import json
import socket
import threading
import time
from pathlib import Path
from typing import Any, Awaitable, Callable, Dict, List

import aiohttp
import aiohttp.web
import pytest
from served import WEB, Served, ask

from merlin_monitor.state.history_events import Event
from merlin_monitor.state.state_tree import apply_changes
from merlin_monitor.web import connections, live_feed, web_server
from merlin_monitor.web.connections import ServerError, listen
from merlin_test import LONG


def test_the_page_brings_its_policy(served: Served) -> None:
    for path in ("", "app.js", "style.css", "state.json", "nothing.js", "control/x"):
        headers = ask(served.url, path).headers
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy and "script-src 'self'" in policy and "unsafe" not in policy
        assert headers["X-Content-Type-Options"] == "nosniff"
    page = ask(served.url).said
    assert "<script>" not in page and "style=" not in page and "http://" not in page, "nothing inline, no CDN"


def test_only_files_of_the_page_are_served(served: Served) -> None:
    for path in (
        *("..%2fpackage.xml", ".hidden", "web_server.py", "%00", "panels", "panels/queue.js"),
        *("panels/..%2fapp.js", "panels/%2e%2e%2f%2e%2e%2fpackage.xml", "panels/%00.js"),
        *(f"{'a' * 300}.js", f"panels/{'a' * 300}.js"),
    ):
        assert ask(served.url, path).status == 404, path
    names = {path.name for path in WEB.iterdir() if path.is_file()}
    for name in {*names, "panels/plan.js"} - {"index.html"}:
        assert ask(served.url, name).status == 200, name


def test_state_map_and_history(served: Served) -> None:
    assert ask(served.url, "map.png").status == 404
    served.state.tree.set("now", "doing", "<b>asking</b>")
    assert json.loads(ask(served.url, "state.json").said)["state"]["now"]["doing"] == "<b>asking</b>"
    for number in range(5):
        served.state.report(Event("plan" if number else "goal", str(number), 1.0))
    page = json.loads(ask(served.url, "history?limit=2").said)
    assert [event["text"] for event in page] == ["3", "4"]
    earlier = json.loads(ask(served.url, f"history?limit=9&before={page[0]['id']}&kinds=goal").said)
    assert [event["text"] for event in earlier] == ["0"]
    for query in ("before=x", "limit=x", "before=-1", f"before={10**30}"):
        assert ask(served.url, f"history?{query}").status == 400, query
    exported = ask(served.url, "history.json")
    assert "attachment" in exported.headers["Content-Disposition"] and len(json.loads(exported.said)) == 5
    assert ask(served.url, "live").status == 426


class Page:
    """Follows the state as a page does."""

    def __init__(self) -> None:
        self.state: Dict[str, Any] = {}
        self.version = 0
        self.frames = 0

    def take(self, message: Dict[str, Any]) -> None:
        self.frames += 1
        self.version = message["version"]
        if "state" in message:
            self.state = message["state"]
        else:
            apply_changes(self.state, message["changes"])


def follow(
    url: str, pages: int, until: Callable[[Page], bool], slow: Callable[[int, Page], Awaitable[None]] = None
) -> List[Page]:
    """Opens pages and reads until each has what is wanted."""

    async def one(session: aiohttp.ClientSession, number: int) -> Page:
        page = Page()
        async with session.ws_connect(url + "live", max_msg_size=0) as live:
            while not until(page):
                page.take(await live.receive_json(timeout=LONG))
                if slow is not None:
                    await slow(number, page)
        return page

    async def run() -> List[Page]:
        async with aiohttp.ClientSession() as session:
            return await asyncio.gather(*(one(session, number) for number in range(pages)))

    return asyncio.run(run())


def changing(served: Served, bursts: int, changes: int) -> threading.Thread:
    def run() -> None:
        for number in range(bursts * changes):
            served.state.tree.set("knowledge", "facts", f"(fact {number % 50})", {"at": number})
            if number % changes == 0:
                time.sleep(0.02)  # some in one frame, some in the next
        served.state.tree.set("now", "doing", "done")

    thread = threading.Thread(target=run, name="changes", daemon=True)
    thread.start()
    return thread


def test_ten_pages_see_the_same_and_changes_come_in_frames(served: Served) -> None:
    thread = changing(served, 50, 20)
    pages = follow(served.url, 10, lambda page: page.state.get("now", {}).get("doing") == "done")
    thread.join()
    expected = json.loads(served.state.tree.as_json()[1])
    for page in pages:
        assert page.state == expected
        assert page.frames < 500, "a thousand changes do not make a thousand frames"


def test_a_page_that_reads_slowly_gets_the_state_and_holds_up_no_other(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine needs long for all that: the slow page does not count as gone meanwhile.
    monkeypatch.setattr(live_feed, "SEND_LIMIT", LONG)
    monkeypatch.setattr(web_server, "PING", LONG)
    served.state.tree.set("knowledge", "facts", {f"(fact {n})": {"at": 0} for n in range(3000)})
    taken = threading.Event()

    def change() -> None:
        # 300 kB at a time, the next when the quick page has these: more than the other connection holds.
        for number in range(60):
            for fact in range(30):
                value = {"at": number, "x": "y" * 10_000}
                served.state.tree.set("knowledge", "facts", f"(fact {fact * 97})", value)
            assert taken.wait(LONG)
            taken.clear()
        served.state.tree.set("now", "doing", "done")

    def until(page: Page) -> bool:
        return page.state.get("now", {}).get("doing") == "done"

    quick: List[asyncio.Event] = []

    async def slowly(number: int, page: Page) -> None:
        if not quick:
            quick.append(asyncio.Event())
        if number == 0:
            await asyncio.wait_for(quick[0].wait(), LONG)  # reads on only when the other has everything
            return
        taken.set()
        if until(page):
            quick[0].set()

    thread = threading.Thread(target=change, name="changes", daemon=True)
    thread.start()
    slow, fast = follow(served.url, 2, until, slowly)
    thread.join()
    expected = json.loads(served.state.tree.as_json()[1])
    assert slow.state == expected and fast.state == expected
    assert slow.frames < fast.frames


def test_a_page_that_closes_is_forgotten_and_nothing_is_kept_for_it(served: Served) -> None:
    before = list(served.state.tree._feeds)  # that of the recorder
    follow(served.url, 3, lambda page: bool(page.state))
    end = time.monotonic() + LONG
    # The feed is closed when the last page is gone.
    while served.state.tree._feeds != before and time.monotonic() < end:
        time.sleep(0.01)
    assert served.state.tree._feeds == before


@pytest.mark.everywhere
def test_a_port_that_is_taken_leads_to_the_next_one() -> None:
    first = listen("127.0.0.1", 0)
    port = first.getsockname()[1]
    second = listen("127.0.0.1", port)
    assert port < second.getsockname()[1] <= port + 20
    first.close()
    second.close()


def test_without_ipv6_localhost_is_served_on_ipv4(monkeypatch: pytest.MonkeyPatch) -> None:
    stream, nowhere = socket.SOCK_STREAM, ("2001:db8::1", 0)  # an address for documents, which no machine has
    found = [
        (socket.AF_INET6, stream, 6, "", nowhere),
        (socket.AF_INET, stream, 6, "", ("127.0.0.1", 0)),
    ]
    monkeypatch.setattr(connections.socket, "getaddrinfo", lambda *_, **__: found)
    with listen("localhost", 0) as served:
        assert served.getsockname()[0] == "127.0.0.1"


@pytest.mark.everywhere
@pytest.mark.parametrize(("host", "port"), [("203.0.113.7", 8080), ("no.such.host.invalid", 0)])
def test_an_address_that_cannot_be_used_is_named(host: str, port: int) -> None:
    with pytest.raises(ServerError, match=host.replace(".", r"\.")):
        listen(host, port)


def test_a_server_that_ends_cuts_no_task_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = []

    class Lingering(connections.SilentConnections):
        async def watch(self, runner: aiohttp.web.AppRunner) -> None:
            for _ in range(2):
                with contextlib.suppress(asyncio.CancelledError):  # it ends some turns later
                    await asyncio.sleep(LONG)
            ended.append(True)

    monkeypatch.setattr(web_server, "SilentConnections", Lingering)
    Served(tmp_path, "").stop()
    assert ended


def test_the_server_ends_at_once_and_closes_its_pages(tmp_path: Path) -> None:
    served = Served(tmp_path, "")

    async def run() -> bool:
        async with aiohttp.ClientSession() as session, session.ws_connect(served.url + "live") as live:
            await live.receive()
            stopped = asyncio.get_event_loop().run_in_executor(None, served.stop)
            await live.receive(timeout=LONG)
            await asyncio.wait_for(stopped, LONG)
            return live.closed

    assert asyncio.run(run())
