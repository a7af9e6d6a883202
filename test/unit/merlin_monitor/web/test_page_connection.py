# SPDX-License-Identifier: Apache-2.0
"""A page that hears nothing says so, whatever keeps its connection open; it comes back by itself."""

from typing import Any, Iterator, List

import pytest
from served import Served
from shown_page import Visit, chromium, fill

from merlin_test import LONG
from merlin_test.stalled_link import StalledLink

pytestmark = pytest.mark.processes

GREY = "() => document.body.dataset.news === 'none'"


@pytest.fixture
def link(served: Served) -> Iterator[StalledLink]:
    made = StalledLink(served.url)
    yield made
    made.close()


def test_a_connection_that_stalls_is_not_live_and_comes_back(served: Served, link: StalledLink) -> None:
    fill(served)
    with chromium() as browser:
        visit = Visit(browser, link.url)
        visit.wait_text("#connection", "live")
        link.stall()
        visit.wait_text("#connection", "no news since")
        visit.wait(GREY)
        # The whole page says it, not only its corner.
        visit.wait_text("#now-doing", "not known: no news since")
        visit.wait_text("#now-because", "before: asking at the kitchen")
        visit.wait_text("#glance-state", "Not known")
        visit.wait_text("#glance-problem", "no news since")
        for cell in ("progress", "next", "end"):
            visit.wait(f"() => document.getElementById('glance-{cell}').innerText.trim() === '–'")
        visit.wait_text("#time-at", "no news since")
        assert visit.page.title().startswith("⚠ not known: no news since")
        assert visit.page.get_attribute("link[rel=icon]", "href") == "icon-bad.svg"
        served.state.tree.set("now", "said", {"doing": "dancing in the dark"})
        link.go_on()
        visit.wait_text("#connection", "live")
        visit.wait_text("#now-doing", "ancing in the dark")
        visit.wait_text("#time-at", "live")
        assert visit.page.title() == "dancing in the dark – MERLIN"
        assert visit.page.get_attribute("link[rel=icon]", "href") == "icon.svg"
        visit.wait("() => document.body.dataset.news === 'live'")
        assert visit.complaints == []
        visit.close()


def test_a_connection_that_stalls_for_good_is_replaced(served: Served, link: StalledLink) -> None:
    fill(served)
    with chromium() as browser:
        visit = Visit(browser, link.url)
        visit.wait_text("#connection", "live")
        sockets: List[Any] = []
        visit.page.on("websocket", lambda socket: sockets.append(socket))
        link.stall()
        visit.wait_text("#connection", "no news since")
        while not sockets:  # it has given the old one up
            visit.page.wait_for_timeout(100)
        link.go_on()
        visit.wait_text("#connection", "live")
        assert visit.complaints == []
        visit.close()


def test_a_stop_on_a_link_that_stalls_is_sent_until_it_is_confirmed(open_stop: Served) -> None:
    fill(open_stop)
    open_stop.state.tree.set("meta", "open_stop", True)
    link = StalledLink(open_stop.url)
    with chromium() as browser:
        visit = Visit(browser, link.url)
        visit.wait_text("#connection", "live")
        asked: List[Any] = []
        visit.page.on(
            "request", lambda request: asked.append(request.url) if "control/stop" in request.url else None
        )
        link.stall()
        visit.page.click("#stop")
        assert visit.page.is_visible("#control-said[data-bad]")  # at once
        visit.wait_text("#control-said", "Sending the stop, for ")
        for _ in range(int(10 * LONG)):
            visit.page.wait_for_timeout(100)
            if len(asked) > 1:
                break
        assert len(asked) > 1, "it is not sent again"
        visit.wait_text("#control-said", "NOT confirmed")
        link.go_on()
        visit.wait_text("#control-said:not([data-bad])", "stopped until")
        assert len(set(open_stop.robot.presses)) == 1 and open_stop.robot.presses[0]
        assert set(open_stop.robot.calls) == {("stop", "a visitor at 127.0.0.1")}
        visit.close()
    link.close()
