# SPDX-License-Identifier: Apache-2.0
"""Which requests the page accepts: hosts, origins, tokens, and what is wrong with a request."""

import asyncio
import json
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Dict, Optional

import aiohttp
import pytest
from served import TOKEN, Served, ask

from merlin_monitor.access.web_access import HostNameError, RequestRefused, WebAccess, WrongTokens
from merlin_monitor.web.web_server import AT_ONCE
from merlin_test import LONG


@pytest.mark.everywhere
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


def refuses(access: WebAccess, host: str) -> bool:
    try:
        access.check_host(host)
    except RequestRefused:
        return True
    return False


@pytest.mark.everywhere
def test_the_address_that_is_printed_is_served(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "Robot-7")
    monkeypatch.setattr(socket, "getfqdn", lambda: "Robot-7.lab")
    for host in ("Robot-7:8080", "Robot-7.lab:8080"):
        assert not refuses(WebAccess("0.0.0.0"), host)
        assert refuses(WebAccess("127.0.0.1"), host)


def test_an_address_of_the_network_lets_in_numbers_and_named_hosts() -> None:
    access = WebAccess("0.0.0.0", ["robot.lab"])
    for host in ("192.168.1.5:8080", "[fe80::1]:8080", "robot.lab", "Robot.Lab:80"):
        assert not refuses(access, host)
    for host in ("evil.example", "192.168.1.5.evil.example", "0x7f.1"):
        assert refuses(access, host)


def test_behind_a_proxy_a_page_of_an_allowed_name_is_not_another_sites() -> None:
    access = WebAccess("127.0.0.1", ["Robot.lab", "desk_1.lab:8443", "[fe80::1]:81", "fe80::2"])
    for host in ("robot.lab:8080", "robot.lab", "desk_1.lab", "desk_1.lab:8443", "[fe80::1]", "[fe80::2]:80"):
        assert not refuses(access, host)
    for origin in ("http://robot.lab", "https://ROBOT.lab", "https://desk_1.lab:8443", "http://[fe80::1]:81"):
        access.check_origin(origin, "127.0.0.1:8080")
    for origin in (
        "http://robot.lab:81",
        "https://desk_1.lab",
        "http://robot.lab.evil.example",
        "ftp://robot.lab",
    ):
        with pytest.raises(RequestRefused, match=r"have it pass on the header Host .*allowed_hosts:="):
            access.check_origin(origin, "127.0.0.1:8080")


@pytest.mark.parametrize(
    "name", ["http://robot.lab", "robot.lab/merlin", "a b", "robot.lab:port", "me@robot.lab", ""]
)
def test_a_name_that_is_none_is_refused_at_the_start(name: str) -> None:
    with pytest.raises(HostNameError, match=f"--allowed-host {name} names no host; give it as robot.lab"):
        WebAccess("127.0.0.1", [name], setting="--allowed-host ")


def test_a_refusal_says_what_would_let_it_in() -> None:
    with pytest.raises(RequestRefused, match=r"'robot.lab'; start it with allowed_hosts:=robot.lab\."):
        WebAccess("127.0.0.1").check_host("robot.lab:80")
    with pytest.raises(RequestRefused, match=r"or start it with --allowed-host robot.lab:81\."):
        WebAccess("127.0.0.1", setting="--allowed-host ").check_origin("http://robot.lab:81", "robot.lab")


def test_a_page_learns_why_it_gets_no_websocket(served: Served) -> None:
    own = f"http://127.0.0.1:{served.server.port}"
    assert ask(served.url, "live", "POST", {"Origin": own}).status == 204
    refused = ask(served.url, "live", "POST", {"Origin": "http://robot.lab"})
    assert refused.status == 403 and "allowed_hosts:=robot.lab" in refused.said
    assert refused.headers["Content-Type"].startswith("text/plain")


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
    assert ask(served.url, "control/cancel_all", "POST", CONTROL).status == 200
    assert ask(served.url, "control/pause", "POST", CONTROL).status == 200
    assert ask(served.url, "control/resume", "POST", CONTROL).status == 200
    assert served.robot.calls == [
        ("send", "(checked kitchen)", 3, "Ana"),
        ("cancel", "/a-1", "Ana"),
        ("cancel_all", "Ana"),
        ("pause", True, "Ana"),
        ("pause", False, "Ana"),
    ]


def test_a_plan_is_only_shown_and_facts_are_set(served: Served) -> None:
    fields = {"goal": "(checked kitchen)", "without": ["(navigate hall)"]}
    planned = ask(served.url, "control/plan", "POST", CONTROL, fields)
    assert planned.status == 200
    plan = json.loads(planned.said)["plan"]
    assert plan["seconds"] == 10.0 and [step["text"] for step in plan["steps"]] == ["(navigate kitchen)"]
    changed = ask(served.url, "control/change", "POST", CONTROL, {"facts": "(not (checked hall))"})
    assert changed.status == 200
    for what in ("plan", "change"):
        assert ask(served.url, f"control/{what}", "POST", {}, fields).status == 403
    assert served.robot.calls == [
        ("plan", "(checked kitchen)", ["(navigate hall)"], "Ana"),
        ("change", "(not (checked hall))", "Ana"),
    ]


def test_breakpoints_step_and_continue(served: Served) -> None:
    for what, fields in (("breakpoints", {"before": ["(ask *)"]}), ("step", {}), ("continue", {})):
        assert ask(served.url, f"control/{what}", "POST", {}, fields).status == 403
        assert ask(served.url, f"control/{what}", "POST", CONTROL, fields).status == 200
    assert served.robot.calls == [
        ("hold_before", ["(ask *)"], "Ana"),
        ("go_on", True, "Ana"),
        ("go_on", False, "Ana"),
    ]


def test_forced_outcomes_and_the_autonomy_level(served: Served) -> None:
    wish = {"state": " NAVIGATE/DRIVE ", "outcome": "succeeded", "within": "/r1/"}
    for what, fields in (("leave", wish), ("leave", {"state": "A/B"}), ("autonomy", {"level": "low"})):
        assert ask(served.url, f"control/{what}", "POST", {}, fields).status == 403
        assert ask(served.url, f"control/{what}", "POST", CONTROL, fields).status == 200
    assert served.robot.calls == [
        ("leave", "NAVIGATE/DRIVE", "succeeded", "/r1/", "Ana"),
        ("leave", "A/B", "", "", "Ana"),
        ("set_autonomy", "low", "Ana"),
    ]


def test_the_stop_button(served: Served) -> None:
    assert ask(served.url, "control/stop", "POST", {}).status in (401, 403)
    stopped = ask(served.url, "control/stop", "POST", CONTROL)
    assert stopped.status == 200 and "stopped until" in stopped.said
    assert served.robot.calls == [("stop", "Ana")]
    released = ask(served.url, "control/release", "POST", CONTROL)
    assert released.status == 409 and "no velocity guard" in released.said


def test_a_stop_waits_for_no_other_request(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, end, plan = threading.Semaphore(0), threading.Event(), served.robot.plan

    def slow_plan(*asked: Any) -> Dict[str, Any]:
        begun.release()
        assert end.wait(LONG)
        return plan(*asked)

    monkeypatch.setattr(served.robot, "plan", slow_plan)
    asking = (served.url, "control/plan", "POST", CONTROL, {"goal": "(a)"})
    with ThreadPoolExecutor(40) as pages:
        plans = [pages.submit(ask, *asking) for _ in range(40)]
        try:
            assert all(begun.acquire(timeout=LONG) for _ in plans)
            assert ask(served.url, "control/stop", "POST", CONTROL).status == 200
        finally:
            end.set()
    assert {each.result().status for each in plans} == {200}


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
        ("plan", {"goal": "(checked moon)"}, 409, "no object 'moon'"),
        ("plan", {"goal": "(a)", "without": "(b)"}, 409, "without is a list"),
        ("plan", {"goal": "(a)", "without": ["(b)"] * 101}, 409, "100 actions at most"),
        ("change", {"goal": "(a)"}, 409, "Write facts"),
        ("breakpoints", {"before": [1]}, 409, "before is a list"),
        ("leave", {"state": 3}, 409, "state is a text"),
        ("autonomy", {"level": "x" * 401}, 409, "400 characters at most"),
        ("cancel", {}, 409, "Name the request"),
        ("cancel", {"request": ["a"]}, 409, "Name the request"),
        ("shutdown", {}, 409, "nothing called"),
        ("send", "no json", 400, "not a JSON object"),
        ("send", "[1]", 400, "not a JSON object"),
        ("send", "[" * 60000, 400, "not a JSON object"),
        ("send", "x" * 100_000, 413, ""),
    ],
)
def test_bad_requests_say_what_is_wrong(served: Served, what: str, body: Any, status: int, said: str) -> None:
    answer = ask(served.url, f"control/{what}", "POST", CONTROL, body)
    assert answer.status == status and said in answer.said, answer.said
    assert served.robot.calls == []


@pytest.mark.parametrize("token", [None, "", "wrong", TOKEN + "x"])
def test_everybody_may_stop_where_that_is_open_and_nothing_else(open_stop: Served, token: Any) -> None:
    headers = {"X-Merlin-Token": token} if token is not None else {}
    assert ask(open_stop.url, "control/stop", "POST", headers).status == 200
    assert open_stop.robot.calls == [("stop", "a visitor at 127.0.0.1")]
    assert ask(open_stop.url, "control/release", "POST", headers).status == 403
    other_site = {**headers, "Origin": "http://evil.example"}
    assert ask(open_stop.url, "control/stop", "POST", other_site).status == 403
    assert len(open_stop.robot.calls) == 1


def test_a_stop_does_not_wait_while_wrong_tokens_do(
    open_stop: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    slowed, end = threading.Semaphore(0), threading.Event()

    async def slow_down(_: WrongTokens, address: str) -> None:
        slowed.release()
        assert await asyncio.get_running_loop().run_in_executor(None, end.wait, LONG)

    monkeypatch.setattr(WrongTokens, "slow_down", slow_down)
    wrong = (open_stop.url, "control/stop", "POST", {"X-Merlin-Token": "wrong"})
    with ThreadPoolExecutor(AT_ONCE) as pages:
        visitors = [pages.submit(ask, *wrong) for _ in range(AT_ONCE)]
        try:
            assert all(slowed.acquire(timeout=LONG) for _ in visitors)
            assert ask(open_stop.url, "control/stop", "POST", CONTROL).status == 200
        finally:
            end.set()
    assert {each.result().status for each in visitors} == {200}


def test_an_operator_who_stops_is_named_where_it_is_open_to_all(open_stop: Served) -> None:
    assert ask(open_stop.url, "control/stop", "POST", CONTROL, {"press": "1"}).status == 200
    assert (open_stop.robot.calls, open_stop.robot.presses) == ([("stop", "Ana")], ["1"])


def test_a_stop_needs_a_token_where_it_is_not_open(served: Served) -> None:
    assert ask(served.url, "control/stop", "POST").status == 403
    assert served.robot.calls == []


def test_what_another_operator_holds_is_released_when_that_was_seen(served: Served) -> None:
    served.robot.holder = "the base is held by Bob since 14:03:07"
    refused = ask(served.url, "control/release", "POST", CONTROL)
    assert refused.status == 409
    assert json.loads(refused.said)["confirm"] == served.robot.holder
    assert ask(served.url, "control/release", "POST", CONTROL, {"seen": "something older"}).status == 409
    assert ask(served.url, "control/release", "POST", CONTROL, {"seen": served.robot.holder}).status == 200
    assert served.robot.calls == [("release", "Ana")]
