# SPDX-License-Identifier: Apache-2.0
"""What is on the first screen, with one robot and with two: nothing has to be looked for."""

from typing import Any, Dict

import pytest
from served import Served
from shown_page import signed_in

pytestmark = pytest.mark.processes

BOXES = """() => Object.fromEntries([...document.querySelectorAll("main > section, #stop, #now-line")]
  .filter((each) => each.checkVisibility()).map((each) => {
    const { left, top, right, bottom } = each.getBoundingClientRect();
    return [each.id, { left, top, right, bottom }];
  }))"""
LINKS = """() => [...document.querySelectorAll("nav a")].filter((link) => {
  const { left, top, right } = link.getBoundingClientRect();
  const seen = document.elementFromPoint((left + right) / 2, top + 8);
  return seen !== link;
}).map((link) => link.textContent)"""
TWO = {"ria": {"does": ["(ask kitchen)"]}, "tom": {"away": "its host is gone", "does": []}}


def boxes(page: Any) -> Dict[str, Dict[str, float]]:
    found: Dict[str, Dict[str, float]] = page.page.evaluate(BOXES)
    return found


def robots_shown(page: Any, served: Served, robots: Dict[str, Any]) -> None:
    served.state.tree.set("robots", "robots", robots)
    page.wait(f"() => document.querySelectorAll('#robots-list li').length === {len(robots)}")


def test_plan_map_and_stop_come_first_on_every_screen(visits: Any, served: Served) -> None:
    page = visits(viewport={"width": 1440, "height": 900})
    page.wait("() => document.querySelectorAll('.machine').length === 3")
    nothing_stands_empty_beside_the_machines(page)
    for sign_in in (False, True):
        assert not page.page.is_visible("#control")
        if sign_in:
            signed_in(page)
            page.page.wait_for_selector("#goal", state="visible")
        for robots in ({}, TWO):
            robots_shown(page, served, robots)
            for width, height, lowest in ((1440, 900, 400), (1024, 768, 420)):
                page.page.set_viewport_size({"width": width, "height": height})
                plan_and_map_are_on_the_first_screen(page, height, lowest, sign_in)
    # Signed-in operators write goals.
    page.page.click("#operator")
    page.page.wait_for_selector("#goal", state="hidden")
    page.page.set_viewport_size({"width": 390, "height": 844})
    for robots in (TWO, {}):
        robots_shown(page, served, robots)
        headline_map_and_stop_come_first(page)


def plan_and_map_are_on_the_first_screen(page: Any, height: int, lowest: int, signed: bool) -> None:
    shown = boxes(page)
    assert shown["map"]["top"] < lowest, shown
    assert shown["plan"]["top"] < (height - 200 if signed else lowest), shown
    assert page.page.evaluate(LINKS) == []


def headline_map_and_stop_come_first(page: Any) -> None:
    shown = boxes(page)
    assert shown["now-line"]["top"] < 200 and shown["map"]["top"] < 520, shown
    assert shown["stop"]["bottom"] < 844 and shown["stop"]["top"] > 700
    others = set(shown) - {"now", "now-line", "robots", "map", "stop"}
    assert all(shown[name]["top"] >= shown["map"]["bottom"] for name in others), shown
    assert page.page.evaluate(LINKS) == []


def nothing_stands_empty_beside_the_machines(page: Any) -> None:
    shown = boxes(page)
    for other in set(shown) - {"machines", "stop", "now-line"}:
        apart = shown[other]["bottom"] <= shown["machines"]["top"]
        assert apart or shown[other]["top"] >= shown["machines"]["bottom"], other
