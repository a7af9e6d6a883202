"""The web server as browsers and others reach it: what is served, to whom, and how changes arrive."""

import asyncio
import json
import socket
import threading
import time
from pathlib import Path
from typing import Any, Awaitable, Callable, Dict, Iterator, List, Optional

import aiohttp
import pytest

from merlin_monitor.state.events import Event
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.state_tree import apply_changes
from merlin_monitor.web.control import Control, ControlError
from merlin_monitor.web.web_access import RequestRefused, WebAccess
from merlin_monitor.web.web_server import ServerError, WebServer, listen

WEB = Path(__file__).resolve().parents[3] / "src" / "merlin_monitor" / "web"
TOKEN = "ünguessable"


class FakeRobot:
    """Notes what is asked of it."""

    def __init__(self) -> None:
        self.calls: List[tuple] = []

    def check(self, goal: str) -> None:
        if "moon" in goal:
            raise ControlError("there is no object 'moon'")

    def send(self, goal: str, priority: int) -> str:
        self.calls.append(("send", goal, priority))
        return "/monitor-1"

    def cancel(self, request: str) -> None:
        self.calls.append(("cancel", request))

    def pause_mission(self, pause: bool) -> str:
        self.calls.append(("pause", pause))
        return "Paused."

    def stop(self) -> str:
        self.calls.append(("stop",))
        return "stopped until merlin/release is called"

    def release(self) -> str:
        raise ControlError("The base was not released: no velocity guard runs.")


class Served:
    """A running server and what belongs to it."""

    def __init__(self, folder: Path, token: str) -> None:
        self.state = MonitorModel(Inbox(), folder / "history.sqlite")
        self.robot = FakeRobot()
        control = Control(self.robot) if token else None
        self.server = WebServer(self.state, WEB, WebAccess("127.0.0.1", token=token), control)
        self.state.start()
        self.server.start()
        self.url = self.server.address

    def stop(self) -> None:
        self.server.stop()
        self.state.stop()


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path, TOKEN)
    yield served
    served.stop()


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path, "")
    yield served
    served.stop()


def ask(
    url: str, path: str = "", method: str = "GET", headers: Optional[Dict[str, str]] = None, body: Any = None
) -> Any:
    """One request; the answer with its text, or as bytes in `body`."""

    async def run() -> Any:
        async with aiohttp.ClientSession() as session:
            data = json.dumps(body) if body is not None and not isinstance(body, (bytes, str)) else body
            async with session.request(method, url + path, headers=headers or {}, data=data) as answer:
                answer.content_bytes = await answer.read()
                answer.said = answer.content_bytes.decode("utf-8", "replace")
                return answer

    return asyncio.run(run())


def test_the_page_brings_its_policy(served: Served) -> None:
    for path in ("", "app.js", "style.css", "state.json", "nothing.js", "control/x"):
        headers = ask(served.url, path).headers
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy and "script-src 'self'" in policy and "unsafe" not in policy
        assert headers["X-Content-Type-Options"] == "nosniff"
    page = ask(served.url).said
    assert "<script>" not in page and "style=" not in page and "http://" not in page, "nothing inline, no CDN"


def test_only_files_of_the_page_are_served(served: Served) -> None:
    for path in ("..%2fpackage.xml", ".hidden", "web_server.py", "%00"):
        assert ask(served.url, path).status == 404, path
    names = {path.name for path in WEB.iterdir()}
    for name in names - {"index.html"}:
        assert ask(served.url, name).status == 200, name


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:{port}", 200),
        ("localhost:{port}", 200),
        ("LOCALHOST", 200),
        ("[::1]:{port}", 200),
        ("evil.example:{port}", 403),
        ("evil.example#localhost", 403),
        ("localhost@evil.example", 403),
        ("10.0.0.1", 403),
        ("localhost:99999", 403),
        ("", 403),
    ],
)
def test_the_host_has_to_be_this_machine(served: Served, host: str, status: int) -> None:
    headers = {"Host": host.format(port=served.server.port)}
    answer = ask(served.url, "state.json", headers=headers)
    assert answer.status == status
    assert status == 200 or "not served under the name" in answer.said


def test_the_address_that_is_printed_is_served() -> None:
    WebAccess("0.0.0.0").check_host(f"{socket.gethostname()}:8080")


def test_an_address_of_the_network_lets_in_numbers_and_named_hosts() -> None:
    access = WebAccess("0.0.0.0", ["robot.lab"])
    for host in ("192.168.1.5:8080", "[fe80::1]:8080", "robot.lab", "Robot.Lab:80"):
        access.check_host(host)
    for host in ("evil.example", "192.168.1.5.evil.example", "0x7f.1"):
        with pytest.raises(RequestRefused):
            access.check_host(host)


def origin_of(served: Served, text: str) -> Dict[str, str]:
    return {"Origin": text.format(port=served.server.port), "X-Merlin-Token": TOKEN}


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        ("http://127.0.0.1:{port}", True),
        ("http://127.0.0.1:{port}1", False),
        ("http://localhost:{port}", False),
        ("http://evil.example", False),
        ("null", False),
        ("http://[", False),
        ("", False),
    ],
)
def test_pages_of_other_sites_get_nothing(served: Served, origin: str, allowed: bool) -> None:
    headers = origin_of(served, origin)
    answer = ask(served.url, "control/pause", "POST", headers)
    assert answer.status == (200 if allowed else 403)
    assert allowed or "other sites" in answer.said

    async def connect() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(
            served.url + "live", headers={"Origin": headers["Origin"]}
        ) as live:
            assert "state" in await live.receive_json()

    if allowed:
        asyncio.run(connect())
    else:
        with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
            asyncio.run(connect())
        assert refused.value.status == 403


@pytest.mark.parametrize("token", [None, "", "wrong", TOKEN + "x", "\xff"])
def test_control_wants_the_token(served: Served, token: Optional[str]) -> None:
    headers = {} if token is None else {"X-Merlin-Token": token}
    answer = ask(served.url, "control/send", "POST", headers, {"goal": "(checked kitchen)"})
    assert answer.status == 403 and "token" in answer.said and served.robot.calls == []


def test_without_a_token_the_page_only_shows(read_only: Served) -> None:
    answer = ask(read_only.url, "control/pause", "POST", {"X-Merlin-Token": ""})
    assert answer.status == 403 and "read-only" in answer.said


CONTROL = {"X-Merlin-Token": TOKEN}


def test_control_with_the_token(served: Served) -> None:
    sent = ask(served.url, "control/send", "POST", CONTROL, {"goal": " (checked kitchen) ", "priority": 3})
    assert sent.status == 200 and json.loads(sent.said) == {"done": "Sent as /monitor-1."}
    assert ask(served.url, "control/cancel", "POST", CONTROL, {"request": "/a-1"}).status == 200
    assert ask(served.url, "control/pause", "POST", CONTROL).status == 200
    assert ask(served.url, "control/resume", "POST", CONTROL).status == 200
    assert served.robot.calls == [
        ("send", "(checked kitchen)", 3),
        ("cancel", "/a-1"),
        ("pause", True),
        ("pause", False),
    ]


def test_the_stop_button(served: Served) -> None:
    assert ask(served.url, "control/stop", "POST", {}).status in (401, 403)
    stopped = ask(served.url, "control/stop", "POST", CONTROL)
    assert stopped.status == 200 and "stopped until" in stopped.said
    assert served.robot.calls == [("stop",)]
    released = ask(served.url, "control/release", "POST", CONTROL)
    assert released.status == 409 and "no velocity guard" in released.said


@pytest.mark.parametrize(
    ("what", "body", "status", "said"),
    [
        ("send", {"goal": "(checked moon)"}, 409, "no object 'moon'"),
        ("check", {"goal": "(checked moon)"}, 409, "no object 'moon'"),
        ("send", {}, 409, "Write a goal"),
        ("send", {"goal": 3}, 409, "Write a goal"),
        ("send", {"goal": "x" * 5000}, 409, "at most"),
        ("send", {"goal": "(a)", "priority": "high"}, 409, "whole number"),
        ("send", {"goal": "(a)", "priority": 2**40}, 409, "whole number"),
        ("cancel", {}, 409, "Name the request"),
        ("cancel", {"request": ["a"]}, 409, "Name the request"),
        ("shutdown", {}, 409, "nothing called"),
        ("send", "no json", 400, "no JSON"),
        ("send", "[1]", 400, "no JSON"),
        ("send", "[" * 60000, 400, "no JSON"),
        ("send", "x" * 100_000, 413, ""),
    ],
)
def test_bad_requests_say_what_is_wrong(served: Served, what: str, body: Any, status: int, said: str) -> None:
    answer = ask(served.url, f"control/{what}", "POST", CONTROL, body)
    assert answer.status == status and said in answer.said, answer.said
    assert served.robot.calls == []


def test_state_map_and_history(served: Served) -> None:
    assert ask(served.url, "map.png").status == 404
    served.state.tree.set("now", "doing", "<b>asking</b>")
    assert json.loads(ask(served.url, "state.json").said)["state"]["now"]["doing"] == "<b>asking</b>"
    for number in range(5):
        served.state.tell(Event("plan" if number else "goal", str(number), 1.0))
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
                page.take(await live.receive_json(timeout=60))
                if slow is not None:
                    await slow(number, page)
        return page

    async def run() -> List[Page]:
        async with aiohttp.ClientSession() as session:
            return await asyncio.gather(*(one(session, number) for number in range(pages)))

    return asyncio.run(run())


def changing(served: Served, count: int, rate: float) -> threading.Thread:
    def run() -> None:
        for number in range(count):
            served.state.tree.set("knowledge", "facts", f"(fact {number % 50})", {"at": number})
            time.sleep(1.0 / rate)
        served.state.tree.set("now", "doing", "done")

    thread = threading.Thread(target=run, name="changes", daemon=True)
    thread.start()
    return thread


def test_ten_pages_see_the_same_and_changes_come_in_frames(served: Served) -> None:
    thread = changing(served, 1000, 1000.0)
    pages = follow(served.url, 10, lambda page: page.state.get("now", {}).get("doing") == "done")
    thread.join()
    expected = json.loads(served.state.tree.as_json()[1])
    for page in pages:
        assert page.state == expected
        assert page.frames < 500, "a thousand changes do not make a thousand frames"


def test_a_page_that_reads_slowly_gets_the_state_and_holds_up_nobody(served: Served) -> None:
    served.state.tree.set("knowledge", "facts", {f"(fact {n})": {"at": 0} for n in range(3000)})
    taken = threading.Event()

    def change() -> None:
        # 300 kB at a time, the next when the quick page has these: more than the other connection holds.
        for number in range(60):
            for fact in range(30):
                value = {"at": number, "x": "y" * 10_000}
                served.state.tree.set("knowledge", "facts", f"(fact {fact * 97})", value)
            assert taken.wait(60.0)
            taken.clear()
        served.state.tree.set("now", "doing", "done")

    def until(page: Page) -> bool:
        return page.state.get("now", {}).get("doing") == "done"

    quick: List[asyncio.Event] = []

    async def slowly(number: int, page: Page) -> None:
        if not quick:
            quick.append(asyncio.Event())
        if number == 0:
            await asyncio.wait_for(quick[0].wait(), 60)  # reads on only when the other has everything
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


def test_who_closes_is_forgotten_and_nothing_is_kept_for_nobody(served: Served) -> None:
    follow(served.url, 3, lambda page: bool(page.state))
    end = time.monotonic() + 10
    while served.server._live.pages and time.monotonic() < end:
        time.sleep(0.01)
    assert served.server._live.pages == 0 and served.state.tree._feeds == []


def test_a_port_that_is_taken_leads_to_the_next_one() -> None:
    first = listen("127.0.0.1", 0)
    port = first.getsockname()[1]
    second = listen("127.0.0.1", port)
    assert port < second.getsockname()[1] <= port + 20
    first.close()
    second.close()


@pytest.mark.parametrize(("host", "port"), [("203.0.113.7", 8080), ("no.such.host.invalid", 0)])
def test_an_address_that_cannot_be_used_is_named(host: str, port: int) -> None:
    with pytest.raises(ServerError, match=host.replace(".", r"\.")):
        listen(host, port)


def test_the_server_ends_at_once_and_closes_its_pages(tmp_path: Path) -> None:
    served = Served(tmp_path, "")

    async def run() -> bool:
        async with aiohttp.ClientSession() as session, session.ws_connect(served.url + "live") as live:
            await live.receive()
            begin = time.monotonic()
            stopped = asyncio.get_event_loop().run_in_executor(None, served.stop)
            await live.receive(timeout=5)
            await stopped
            assert time.monotonic() - begin < 2.0
            return live.closed

    assert asyncio.run(run())
