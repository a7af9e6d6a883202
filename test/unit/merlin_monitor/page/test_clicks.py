# SPDX-License-Identifier: Apache-2.0
"""What is pressed or has the focus stays what it was, whatever the robot does meanwhile: in Chromium."""

from typing import Any, Callable

import pytest
from served import Served
from shown_page import Visit, signed_in

pytestmark = pytest.mark.processes

WAITS = "/mission-4-1.0"  # a request of the filled page
#: Keeps what the page has heard, and lets a press take as long as a test on a busy machine needs.
LISTEN = """(() => {
  const Socket = WebSocket, wait = setTimeout;
  window.heard = "";
  window.WebSocket = class extends Socket {
    constructor(address) {
      super(address);
      this.addEventListener("message", ({ data }) => { window.heard += data; });
    }
  };
  window.setTimeout = (call, ms, ...more) => wait(call, ms === 1000 ? 1e6 : ms, ...more);
})()"""
DRAWN = "() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))"


def changes(served: Served, visit: Visit, name: str, *change: Any) -> None:
    """Something changes, and the page has heard of it, and drawn it if it does so now."""
    served.state.tree.set(*change)
    served.state.tree.set("map", "heard", name)
    visit.wait("(name) => window.heard.includes(name)", f'"{name}"')
    visit.page.evaluate(DRAWN)


def press(visit: Visit, selector: str) -> None:
    """The mouse goes down on an element, and is not let go."""
    visit.page.hover(selector)
    visit.page.mouse.down()


def asked(served: Served, visit: Visit, *call: Any) -> None:
    """The robot was asked for this alone."""
    visit.wait_text("#control-said", ".")
    assert served.robot.calls == [call]


def serves(request: str) -> Any:
    """The section of an Executor that serves another request."""
    return {"request": request, "goals": [], "priority": 0, "state": "running", "done": 0, "total": 1}


def cancel_of(number: int) -> str:
    return f"#queue-list li:nth-child({number}) .cancel"


def a_click_reaches_the_row_although_the_one_before_is_replaced(served: Served, visit: Visit) -> None:
    press(visit, cancel_of(2))
    changes(served, visit, "one begins", "now", "executor", serves("/mission-9-1.0"))
    visit.page.mouse.up()
    asked(served, visit, "cancel", WAITS, "Ana")


def nothing_moves_under_a_press_and_all_is_drawn_after_it(served: Served, visit: Visit) -> None:
    press(visit, cancel_of(2))
    changes(served, visit, "it has ended", "now", "executor", {})
    visit.page.mouse.up()
    asked(served, visit, "cancel", WAITS, "Ana")
    visit.wait("() => document.querySelectorAll('#queue-list li').length === 1")


def a_button_does_what_it_says_when_it_is_pressed(served: Served, visit: Visit) -> None:
    press(visit, "#pause")
    paused = {**served.state.tree.get("now", "executor"), "paused": True}
    changes(served, visit, "another operator pauses", "now", "executor", paused)
    assert visit.text("#pause") == "Pause"
    visit.page.mouse.up()
    asked(served, visit, "pause", True, "Ana")
    visit.wait_text("#pause", "Resume")


def the_focus_stays_on_a_row_when_those_before_it_go(served: Served, visit: Visit) -> None:
    visit.page.focus(cancel_of(2))
    changes(served, visit, "it has ended", "now", "executor", {})
    visit.wait("() => document.querySelectorAll('#queue-list li').length === 1")
    visit.page.keyboard.press("Enter")
    asked(served, visit, "cancel", WAITS, "Ana")


def the_focus_stays_on_a_row_that_changes_its_place(served: Served, visit: Visit) -> None:
    names = "() => [...document.querySelectorAll('.machine .name')].map((name) => name.textContent)"
    before = visit.page.evaluate(names)
    place = next(place for place, name in enumerate(before) if "NAVIGATE" in name)
    assert place > 0
    visit.page.locator(".machine .name").nth(place).focus()
    key = next(key for key in served.state.tree.keys("machines", "containers") if "NAVIGATE" in key)
    changes(served, visit, "it begins", "machines", "containers", key, "active", ["DRIVE"])
    visit.wait(f"() => ({names})()[0].includes('NAVIGATE')")
    assert "NAVIGATE" in visit.text(".machine .name:focus")


def a_slider_that_is_dragged_is_seen_to_move(served: Served, visit: Visit) -> None:
    press(visit, "#time-range")
    visit.wait("() => document.body.dataset.time === 'past'")
    visit.wait("() => document.title.startsWith('PAST')")
    visit.page.mouse.up()


CASES = (
    a_click_reaches_the_row_although_the_one_before_is_replaced,
    nothing_moves_under_a_press_and_all_is_drawn_after_it,
    a_button_does_what_it_says_when_it_is_pressed,
    the_focus_stays_on_a_row_when_those_before_it_go,
    the_focus_stays_on_a_row_that_changes_its_place,
    a_slider_that_is_dragged_is_seen_to_move,
)


def test_what_is_pressed_or_has_the_focus_stays_what_it_was(
    visits: Callable[..., Visit], served: Served
) -> None:
    """On the page of a robot that serves a request while another one waits; Ana is signed in."""
    visit = visits(script=LISTEN)
    signed_in(visit)
    executor = served.state.tree.get("now", "executor")
    for case in CASES:
        served.state.tree.set("now", "executor", executor)
        visit.wait("() => document.querySelectorAll('#queue-list .cancel').length === 2")
        visit.wait_text("#pause", "Pause")
        visit.page.evaluate("document.getElementById('control-said').textContent = ''")
        served.robot.calls.clear()
        case(served, visit)
