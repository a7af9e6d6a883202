# SPDX-License-Identifier: Apache-2.0
"""The page goes back to any moment of the history, and never takes it for the present: in Chromium."""

import json
import random
import time
from pathlib import Path
from typing import Any, Iterator, List, Tuple

import pytest
from served import TOKEN, WEB, Served

from merlin_monitor.state.history_events import Event
from merlin_monitor.state.state_tree import apply_changes
from merlin_monitor.web.open_command import opened
from merlin_test import LONG
from merlin_test.chromium import Visit

pytestmark = pytest.mark.processes

PANELS = ("now", "control", "plan", "queue", "map", "machines", "health", "knowledge", "history")
TITLED = PANELS[2:]


@pytest.fixture
def shown(served: Served) -> Iterator[Served]:
    """A server whose pages show all panels, and whose robot has done twelve things."""
    panels = [{"name": name, "title": name.title() if name in TITLED else "", "width": 6} for name in PANELS]
    served.scripts.update({name: WEB / "panels" / f"{name}.js" for name in PANELS})
    tree = served.state.tree
    served.state.checked_at = float("inf")  # without a pulse the pages get this once: all is up to date
    for field, value in (("panels", panels), ("control", True), ("simulated", True), ("time", 0.5)):
        tree.set("meta", field, value)
    yield served


def does(served: Served, number: int, mark: str = "") -> None:
    """Something happens, is reported, and is recorded before it returns."""
    tree = served.state.tree
    tree.set("meta", "time", 1.0 + number)
    tree.set("knowledge", "facts", f"(fact {number})", {"by": "test", "at": float(number)})
    tree.remove("knowledge", "facts", f"(fact {number - 3})")
    tree.set("map", "robot", [number / 10, 1.0, 0.0])
    tree.set("map", "points", {"kitchen": [1.0, 2.0, 0.0]})
    tree.set("health", "parts", {"part": {"level": "ok", "message": f"message {number}", "values": []}})
    tree.set("now", "said", {"doing": f"doing {number}"})
    tree.set("now", "doing", f"doing {number}")
    served.state.report(Event("action", f"event {number}", float(number), {}, mark))
    recorded(served, number)


def recorded(served: Served, number: int) -> None:
    """Waits until this is in the history: the event, and what was shown at its time or later."""
    history = served.state.history
    assert history is not None
    end = time.monotonic() + LONG
    while time.monotonic() < end:
        events = history.page(limit=1).result(LONG)
        segment = json.loads(history.segment(history.run, 1e12).result(LONG) or "null")
        if segment is not None and events and events[0]["text"] == f"event {number}":
            (_, _, state, _), *later = segment["frames"]
            for _, _, changes, _ in later:
                apply_changes(state, changes)
            shown = state["now"]["doing"] == f"doing {number}"
            if shown and segment["frames"][-1][0] >= events[0]["wall"]:
                return
        time.sleep(0.02)
    raise AssertionError("the recorder does not record")


LOOK = """() => [
  document.getElementById("now-doing").textContent, document.getElementById("clock").textContent,
  document.getElementById("map-note").textContent, document.querySelector("#health-list .more").textContent,
  [...document.querySelectorAll(".fact")].filter((row) => !row.hidden).map((row) => row.textContent),
]"""


def test_ten_random_moments_are_shown_and_keys_lead_from_event_to_event(shown: Served, browser: Any) -> None:
    visit = Visit(browser, f"{shown.url}?lang=en")
    assert not visit.page.is_visible("#past-banner")
    seen: List[Tuple[str, Any]] = []
    for number in range(12):
        does(shown, number, {4: "failure", 7: "cancel", 9: "replan"}.get(number, ""))
        visit.wait_text("#now-doing", f"doing {number}")
        visit.wait_text("#history-list .said", f"event {number}")
        visit.wait_text("#clock", f"{number + 1}.0 s")
        seen.append(
            (
                visit.page.locator("#history-list .event a.at").first.get_attribute("href"),
                visit.page.evaluate(LOOK),
            )
        )
    for moment, live in random.Random(7).sample(seen, 10):
        visit.page.evaluate("(hash) => { location.hash = hash; }", moment)
        visit.wait_text("#now-doing", live[0])
        visit.wait(f"(live) => JSON.stringify(({LOOK})()) === JSON.stringify(live)", live)
    visit.page.keyboard.press("l")
    visit.wait_text("#now-doing", "doing 11")
    assert visit.page.url == f"{shown.url}?lang=en"
    keys_lead_from_event_to_event_and_back_to_the_present(shown, browser, visit)
    assert visit.complaints == []
    visit.close()


def past(visit: Visit, doing: str) -> None:
    visit.wait_text("#now-doing", doing)
    visit.wait("() => document.body.dataset.time === 'past'")
    visit.wait("() => document.title.startsWith('PAST')")
    visit.wait_text("#connection", "past")
    assert "PAST" in visit.text("#past-banner strong")


def keys_lead_from_event_to_event_and_back_to_the_present(shown: Served, browser: Any, visit: Visit) -> None:
    visit.wait_text("#connection", "live")
    press = visit.page.keyboard.press
    for key, doing in (
        *((",", "doing 11"), (",", "doing 10"), (".", "doing 11"), ("Shift+F", "doing 4"), ("c", "doing 7")),
        *(("r", "doing 9"), ("Shift+C", "doing 7"), (".", "doing 8")),
    ):
        press(key)
        past(visit, doing)
        visit.wait_text("#past-banner .event-text", doing.replace("doing", "event"))
    press("f")
    visit.wait_text("#time-said", "no later failure")
    # The later events are there still, and a click on one leads to its moment.
    visit.wait("() => document.querySelectorAll('.event[data-later]').length === 3")
    visit.page.locator(".event", has_text="event 2").dispatch_event("click")  # wherever it lies
    past(visit, "doing 2")
    # The address can be given to others.
    other = Visit(browser, visit.page.url)
    past(other, "doing 2")
    other.close()
    # The present goes on meanwhile, and does not change what is shown.
    does(shown, 12)
    visit.wait_text("#past-banner .present", "Now, in fact: doing 12")
    assert visit.text("#now-doing") == "doing 2"
    press("Escape")
    visit.wait_text("#now-doing", "doing 12")
    visit.wait_text("#connection", "live")
    assert not visit.page.is_visible("#past-banner") and "#" not in visit.page.url
    assert not visit.page.title().startswith("PAST")


def test_what_happens_before_a_press_does_not_move_the_event_under_the_pointer(
    shown: Served, browser: Any
) -> None:
    for number in range(40):
        does(shown, number)
    visit = Visit(browser, shown.url)
    visit.wait_text("#connection", "live")
    events = visit.page.locator("#history-list")
    events.locator(".event", has_text="event 37").hover()
    for number in (40, 41):
        does(shown, number)
        visit.wait_text("#history-list .said", f"event {number}")
    visit.page.mouse.down()
    visit.page.mouse.up()
    past(visit, "doing 37")
    visit.page.keyboard.press("l")
    visit.page.mouse.move(1, 1)  # away: what is new is in sight again, and stays so
    visit.wait("() => document.getElementById('history-list').scrollTop === 0")
    # A reader who has gone down the list stays there.
    events.hover()
    visit.page.mouse.wheel(0, 300)
    visit.wait("() => document.getElementById('history-list').scrollTop === 300")
    first = visit.page.evaluate("() => document.querySelector('#history-list .event').offsetHeight")
    does(shown, 42)
    visit.wait_text("#history-list .said", "event 42")
    visit.page.mouse.move(1, 1)
    visit.wait("(top) => document.getElementById('history-list').scrollTop === top", 300 + first)
    visit.close()


def test_no_event_is_missing_when_kinds_are_chosen_while_older_ones_are_on_their_way(
    shown: Served, browser: Any
) -> None:
    for number in range(700):
        shown.state.report(Event("action", f"event {number}", float(number), {}))
    does(shown, 700)
    visit = Visit(browser, shown.url)
    rows = "(count) => document.querySelectorAll('#history-list .event').length === count"
    end = "() => document.getElementById('history-list').scrollTo(0, 1e9)"
    visit.wait(rows, 200)
    visit.page.evaluate(end)
    visit.wait(rows, 400)
    held: List[Any] = []
    visit.page.route("**/history?*", lambda route: held.append(route), times=1)
    with visit.page.expect_request("**/history?*"):
        visit.page.evaluate(end)
    for _ in range(2):  # the same ones in the end, in the same order: what was loaded before is forgotten
        visit.page.locator("#history-kinds button").last.click()
    visit.wait(rows, 200)
    held[0].continue_()
    last = "() => [...document.querySelectorAll('#history-list .said')].at(-1).textContent === 'event 0'"
    visit.wait(f"() => {{ ({end})(); return ({last})(); }}")
    assert visit.texts("#history-list .said") == [f"event {number}" for number in range(700, -1, -1)]
    visit.close()


def test_a_moment_comes_late_is_asked_for_again_or_never_comes(shown: Served, browser: Any) -> None:
    for number in range(4):
        does(shown, number, "failure" if number == 1 else "")
    visit = Visit(browser, shown.url)
    visit.wait_text("#now-doing", "doing 3")
    visit.wait_text("#connection", "live")
    a_moment_that_comes_late_is_not_shown_any_more(visit)
    a_moment_that_is_asked_for_again_is_shown(visit)
    an_address_counts_although_a_moment_that_arrives_writes_it_over(visit)
    a_history_that_does_not_answer_is_named_when_it_is_to_be_played(visit)
    a_monitor_that_hangs_is_named_after_a_limit(visit)
    visit.close()


def live_anew(visit: Visit) -> None:
    """Loads the page again, in the present: without the moments that it has."""
    visit.page.keyboard.press("l")
    visit.page.reload()
    visit.wait_text("#now-doing", "doing 3")
    visit.wait_text("#connection", "live")


def a_moment_that_comes_late_is_not_shown_any_more(visit: Visit) -> None:
    other = visit.page.locator(".event", has_text="event 2").locator("a.at").get_attribute("href")
    for leave, doing in (("live", "doing 3"), (other, "doing 2")):
        held: List[Any] = []
        visit.page.route("**/past/segment?*", lambda route: held.append(route), times=1)  # noqa: B023
        visit.page.keyboard.press("Shift+F")  # to event 1
        while not held:
            visit.page.wait_for_timeout(20)
        if leave == "live":
            visit.page.keyboard.press("l")
        else:
            visit.page.evaluate("(hash) => { location.hash = hash; }", leave)
            past(visit, doing)
        with visit.page.expect_response("**/past/segment?*") as answer:
            held[0].continue_()
        answer.value.finished()
        # What the page makes of it is drawn with the next frame.
        visit.page.evaluate("() => fetch('past/runs').then((answer) => answer.json())")
        visit.page.evaluate(
            "() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))"
        )
        assert visit.text("#now-doing") == doing
        assert visit.page.is_visible("#past-banner") == (leave != "live")
        live_anew(visit)


def a_moment_that_is_asked_for_again_is_shown(visit: Visit) -> None:
    visit.page.route("**/past/segment?*", lambda route: route.abort(), times=1)
    event = visit.page.locator(".event", has_text="event 2")
    event.dispatch_event("click")
    visit.wait_text("#time-said", "cannot be shown")
    event.dispatch_event("click")
    past(visit, "doing 2")
    visit.wait_text("#past-banner .event-text", "event 2")


def a_history_that_does_not_answer_is_named_when_it_is_to_be_played(visit: Visit) -> None:
    visit.page.route("**/past/runs?*", lambda route: route.fulfill(status=503, body="it is busy"))
    live_anew(visit)
    visit.page.keyboard.press("k")
    visit.wait_text("#time-said", "The history does not answer: ")
    assert visit.text("#time-play") == "▶"
    visit.page.unroute("**/past/runs?*")
    visit.page.keyboard.press("k")
    visit.wait("() => document.body.dataset.time === 'past'")


def a_monitor_that_hangs_is_named_after_a_limit(visit: Visit) -> None:
    visit.page.keyboard.press("l")
    visit.page.route("**/answers.js", soon)
    for asked in ("past/segment", "history"):
        visit.page.route(f"**/{asked}?*", lambda route: None)  # is never answered
    visit.page.reload()
    visit.wait_text("#history-trouble", "The monitor does not answer.")
    visit.wait_text("#connection", "live")
    visit.page.locator(".event", has_text="event 2").dispatch_event("click")
    visit.wait_text("#time-said", "The monitor does not answer.")


def soon(route: Any) -> None:
    """Serves a script of the page with a limit that a test need not wait for."""
    script = route.fetch().text()
    assert "PATIENCE = 15000" in script
    route.fulfill(body=script.replace("PATIENCE = 15000", "PATIENCE = 500"), content_type="text/javascript")


def an_address_counts_although_a_moment_that_arrives_writes_it_over(visit: Visit) -> None:
    live_anew(visit)
    visit.page.keyboard.press(",")
    past(visit, "doing 3")
    wanted = visit.page.locator(".event", has_text="event 1").locator("a.at").get_attribute("href")
    visit.page.evaluate(
        "(wanted) => { const { href } = location; location.hash = wanted;"
        " history.replaceState(null, '', href); }",
        wanted,
    )
    past(visit, "doing 1")


def test_nothing_of_the_past_can_be_acted_on_but_the_robot_can_be_stopped(
    shown: Served, browser: Any
) -> None:
    shown.state.tree.set(
        "now",
        "executor",
        {"request": "r1", "goals": ["(g)"], "priority": 0, "state": "running", "done": 0, "total": 1},
    )
    does(shown, 1)
    shown.state.tree.set("now", "executor", {})
    does(shown, 2)
    visit = Visit(browser, shown.url)
    visit.page.click("#operator")
    visit.page.fill("#token", TOKEN)
    visit.page.keyboard.press("Enter")
    visit.wait_text("#operator", "Ana")
    for _ in range(2):
        visit.page.click("#time-back")
    past(visit, "doing 1")
    visit.wait("() => document.querySelectorAll('#queue-list li').length === 1")
    assert not visit.page.is_visible("#queue-list .cancel") and not visit.page.is_visible("#pause")
    assert not visit.page.is_visible("#goal-form")
    visit.page.click("#stop")
    visit.wait_text("#control-said", "stopped")
    visit.page.set_viewport_size({"width": 390, "height": 800})
    visit.page.click("#stop")  # the bar does not lie over it
    visit.wait("() => document.documentElement.scrollWidth <= window.innerWidth")
    end = time.monotonic() + LONG
    while shown.robot.calls != [("stop", "Ana")] * 2 and time.monotonic() < end:
        time.sleep(0.02)
    assert shown.robot.calls == [("stop", "Ana")] * 2
    past(visit, "doing 1")
    visit.close()


def test_it_plays_to_the_end_and_the_slider_takes_keys(shown: Served, browser: Any) -> None:
    for number in range(8):
        does(shown, number)
    visit = Visit(browser, shown.url)
    visit.wait_text("#now-doing", "doing 7")
    visit.page.keyboard.press("t")
    visit.page.keyboard.press("Home")
    visit.wait("() => document.body.dataset.time === 'past'")
    visit.wait("() => Number(document.getElementById('time-range').value) < 0.01")
    visit.page.evaluate(
        "() => { window.seen = new Set(); new MutationObserver(() => window.seen.add("
        "document.getElementById('now-doing').textContent)).observe(document.getElementById('now-doing'),"
        " { childList: true, characterData: true, subtree: true }); }"
    )
    visit.page.keyboard.press("k")
    visit.wait_text("#now-doing", "doing 7")
    seen = set(visit.page.evaluate("() => [...window.seen]"))
    assert {f"doing {number}" for number in range(2, 8)} <= seen
    visit.page.keyboard.press("k")
    visit.wait("() => document.getElementById('time-play').textContent === '▶'")
    past(visit, "doing 7")
    visit.close()


def test_strange_addresses_show_the_present_or_say_why_not(shown: Served, browser: Any) -> None:
    does(shown, 1)
    visit = Visit(browser, shown.url + "#moment=x@y")
    for hash in ("#moment=1@1e9", "#moment=1@1;alert(1)", "#moment=-1@5", "#moment="):
        visit.page.evaluate("(hash) => { location.hash = hash; }", hash)
        visit.wait_text("#now-doing", "doing 1")
        visit.wait_text("#connection", "live")
    assert visit.complaints == []
    visit.close()
    visit = Visit(browser, shown.url + "#moment=99@5")
    visit.wait_text("#time-said", "not known what was shown")
    visit.wait_text("#connection", "live")
    visit.close()


def test_a_run_that_has_ended_is_opened_from_its_folder(
    shown: Served, browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panels = shown.state.tree.get("meta", "panels")
    for panel in panels:
        panel["script"] = f"package://merlin_monitor/web/panels/{panel['name']}.js"
    foreign = {"name": "tables", "title": "Tables", "width": 6, "script": "package://nowhere/web/tables.js"}
    shown.state.tree.set("meta", "panels", [*panels, foreign])
    for number in range(6):
        does(shown, number, "failure" if number == 2 else "")
    shown.server.stop()
    shown.state.stop()
    monkeypatch.chdir(tmp_path.parent)
    with opened(tmp_path, "127.0.0.1", 0) as server:
        visit = Visit(browser, server.address)
        visit.wait_text("#past-banner strong", f"RECORDING of {tmp_path.name}")
        visit.wait_text("#now-doing", "doing 5")
        visit.wait_text("#connection", "past")
        assert not visit.page.is_visible("#time-live") and not visit.page.is_visible("#stop")
        visit.page.keyboard.press("l")
        visit.page.keyboard.press("Shift+F")
        visit.wait_text("#now-doing", "doing 2")
        visit.wait_text("#history-list .said", "event 5")
        visit.page.select_option("#time-speed", "60")
        visit.page.keyboard.press("k")
        visit.wait_text("#time-said", "The end of this run.")
        visit.wait_text("#now-doing", "doing 5")
        assert "Tables" not in visit.texts("nav a")
        assert visit.complaints == []
        visit.close()


def test_a_page_that_stays_open_when_its_run_ends_shows_the_recording(
    shown: Served, browser: Any, tmp_path: Path
) -> None:
    panels = shown.state.tree.get("meta", "panels")
    for panel in panels:
        panel["script"] = f"package://merlin_monitor/web/panels/{panel['name']}.js"
    shown.state.tree.set("meta", "panels", panels)
    for number in range(2):
        does(shown, number)
    visit = Visit(browser, shown.url)
    visit.wait_text("#now-doing", "doing 1")
    visit.wait_text("#connection", "live")
    shown.server.stop()
    shown.server._thread.join(LONG)  # its port is free then
    shown.state.stop()
    with opened(tmp_path, "127.0.0.1", shown.server.port) as server:
        assert server.address == shown.url
        # It loads anew by itself, which a locator outlasts.
        visit.page.locator("#past-banner strong", has_text="RECORDING of").wait_for()
        visit.wait_text("#now-doing", "doing 1")
        visit.wait_text("#connection", "past")
        assert not visit.page.is_visible("#stop")
        assert visit.complaints == []
    visit.close()
