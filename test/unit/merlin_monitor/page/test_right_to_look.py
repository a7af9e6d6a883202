# SPDX-License-Identifier: Apache-2.0
"""On an address that others reach, what the robot does is sent to operators only, whatever is asked for."""

import asyncio
import json
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional

import aiohttp
import pytest
from served import TOKEN, Served, ask
from shown_page import Visit, fill

from merlin_monitor.access.operators import write_operators
from merlin_monitor.access.web_access import LOOK_COOKIE, NO_LOOK, NOBODY_LOOKS, TOKEN_HEADER
from merlin_test import LONG

pytestmark = pytest.mark.processes

SHOWN = (
    *("state.json", "map.png", "pictures/seen.png", "history", "history.json", "past/runs"),
    *("past/marks?run=1", "past/event?run=1&wall=1", "past/segment?run=1&wall=1"),
)
#: Of the filled page: what was said, heard, and is known.
PRIVATE = ("Do you need anything?", "a coffee please", "kitchen", "Round")


@pytest.fixture
def reached(tmp_path: Path) -> Iterator[Served]:
    """Others reach it; everybody may stop the robot."""
    served = Served(tmp_path, TOKEN, open_stop=True, host="0.0.0.0")
    served.state.tree.set("meta", "open_stop", True)
    fill(served)
    yield served
    served.stop()


def key_of(served: Served) -> str:
    said = ask(served.url, "control/who", "POST", {TOKEN_HEADER: TOKEN})
    return str(json.loads(said.said).get("look", ""))


async def first_messages(url: str, cookie: Optional[str], until: Any) -> List[Dict[str, Any]]:
    headers = {"Cookie": f"{LOOK_COOKIE}-1={cookie}"} if cookie else {}
    found: List[Dict[str, Any]] = []
    session = aiohttp.ClientSession()
    async with session, session.ws_connect(f"{url}live", headers=headers) as socket:
        while not until(found):
            message = await asyncio.wait_for(socket.receive(), LONG)
            if message.type is not aiohttp.WSMsgType.TEXT:
                found.append({"closed": True})
                break
            found.append(json.loads(message.data))
    return found


def test_without_the_right_nothing_of_the_robot_is_sent(reached: Served) -> None:
    for path in SHOWN:
        answer = ask(reached.url, path)
        assert (answer.status, answer.said.strip()) == (403, NO_LOOK), path
        assert ask(reached.url, path, headers={"Cookie": f"{LOOK_COOKIE}-1=guessed"}).status == 403, path
    sent = asyncio.run(first_messages(reached.url, None, lambda found: len(found) > 2))
    state = sent[0]["state"]
    assert set(state) == {"visitor", "meta"} and state["meta"]["control"] and state["meta"]["open_stop"]
    assert not any(word in json.dumps(sent) for word in PRIVATE)
    for path in ("", "app.js", "panels/plan.js"):  # the page itself is not secret
        assert ask(reached.url, path).status == 200, path


def test_an_operators_key_opens_it_until_the_operator_is_removed(reached: Served) -> None:
    key = key_of(reached)
    assert TOKEN not in key
    cookie = {"Cookie": f"other=1; {LOOK_COOKIE}-8080={key}"}
    for path in SHOWN:
        assert ask(reached.url, path, headers=cookie).status in (200, 404), path
    assert ask(reached.url, "control/who", "POST", {TOKEN_HEADER: key}).status == 403, "it only looks"
    write_operators(reached.operators, {"Bo": "another long token"})
    assert ask(reached.url, "state.json", headers=cookie).status == 403


def test_a_page_that_is_open_ends_with_the_right(reached: Served) -> None:
    def removed(found: List[Dict[str, Any]]) -> bool:
        if len(found) == 1:
            assert "now" in found[0]["state"]
            write_operators(reached.operators, {"Bo": "another long token"})
            reached.state.tree.set("now", "doing", "a secret")
        return "closed" in str(found[-1:])

    sent = asyncio.run(first_messages(reached.url, key_of(reached), removed))
    assert "a secret" not in json.dumps(sent)


@pytest.mark.parametrize(
    ("host", "open_look"), [("127.0.0.1", False), ("localhost", False), ("0.0.0.0", True)]
)
def test_here_and_where_it_is_wanted_everybody_looks(tmp_path: Path, host: str, open_look: bool) -> None:
    served = Served(tmp_path, TOKEN, host=host, open_look=open_look)
    assert ask(served.url, "state.json").status == 200
    assert key_of(served) == "", "no key is needed"
    served.stop()


def test_without_operators_it_says_how_to_make_one(tmp_path: Path) -> None:
    served = Served(tmp_path, "", host="0.0.0.0")
    assert ask(served.url, "state.json").said.strip() == NOBODY_LOOKS
    sent = asyncio.run(first_messages(served.url, None, bool))
    assert sent[0]["state"]["visitor"] == NOBODY_LOOKS and not sent[0]["state"]["meta"]["control"]
    served.stop()


def test_the_page_asks_for_the_sign_in_and_stops_without_it(reached: Served, browser: Any) -> None:
    visit = Visit(browser, reached.url)
    visit.wait_text("#look", NO_LOOK)
    assert not any(word in (visit.page.text_content("body") or "") for word in PRIVATE)
    visit.page.click("#stop")
    visit.wait_text("#control-said", "stopped until")
    assert reached.robot.calls == [("stop", "a visitor at 127.0.0.1")]
    visit.page.click("#operator")
    visit.page.fill("#token", TOKEN)
    with visit.page.expect_navigation():
        visit.page.keyboard.press("Enter")
    visit.wait_text("#now-doing", "asking at the kitchen")
    visit.wait_text("#operator", "Ana")
    visit.wait(
        "() => { const { complete, naturalWidth } = document.getElementById('said-picture');"
        " return complete && naturalWidth > 0; }"
    )
    other = Visit(browser, reached.url, beside=visit)  # looks, and controls nothing
    other.wait_text("#now-doing", "asking at the kitchen")
    other.wait_text("#operator", "Sign in")
    with visit.page.expect_navigation():
        visit.page.click("#operator")
    visit.wait_text("#look", NO_LOOK)
    assert visit.page.evaluate("async () => (await fetch('state.json')).status") == 403
    for each in (other, visit):
        assert each.complaints == []
        each.close()
