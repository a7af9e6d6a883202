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


@pytest.mark.parametrize("robots", [{}, TWO], ids=["one robot", "two robots"])
@pytest.mark.parametrize(("width", "height", "lowest"), [(1440, 900, 400), (1024, 768, 420)])
def test_plan_and_map_are_on_the_first_screen(
    visits: Any, served: Served, robots: Dict[str, Any], width: int, height: int, lowest: int
) -> None:
    page = visits(viewport={"width": width, "height": height})
    served.state.tree.set("robots", "robots", robots)
    page.wait(f"() => document.querySelectorAll('#robots-list li').length === {len(robots)}")
    shown = boxes(page)
    assert shown["plan"]["top"] < lowest and shown["map"]["top"] < lowest, shown
    assert page.page.evaluate(LINKS) == []
    signed_in(page)
    page.page.wait_for_selector("#goal", state="visible")
    shown = boxes(page)
    assert shown["map"]["top"] < lowest and shown["plan"]["top"] < height - 200, shown
    assert page.page.evaluate(LINKS) == []


@pytest.mark.parametrize("robots", [{}, TWO], ids=["one robot", "two robots"])
def test_on_a_phone_headline_map_and_stop_come_first(
    visits: Any, served: Served, robots: Dict[str, Any]
) -> None:
    page = visits(viewport={"width": 390, "height": 844})
    served.state.tree.set("robots", "robots", robots)
    page.wait(f"() => document.querySelectorAll('#robots-list li').length === {len(robots)}")
    shown = boxes(page)
    assert shown["now-line"]["top"] < 200 and shown["map"]["top"] < 520, shown
    assert shown["stop"]["bottom"] < 844 and shown["stop"]["top"] > 700
    others = set(shown) - {"now", "now-line", "robots", "map", "stop"}
    assert all(shown[name]["top"] >= shown["map"]["bottom"] for name in others), shown
    assert page.page.evaluate(LINKS) == []


def test_goals_are_written_by_those_who_are_signed_in(visits: Any) -> None:
    page = visits()
    assert not page.page.is_visible("#control")
    signed_in(page)
    page.page.wait_for_selector("#goal", state="visible")
    page.page.click("#operator")
    page.page.wait_for_selector("#goal", state="hidden")


def test_nothing_stands_empty_beside_the_machines(visits: Any) -> None:
    page = visits(viewport={"width": 1440, "height": 900})
    page.wait("() => document.querySelectorAll('.machine').length === 3")
    shown = boxes(page)
    for other in set(shown) - {"machines", "stop", "now-line"}:
        apart = shown[other]["bottom"] <= shown["machines"]["top"]
        assert apart or shown[other]["top"] >= shown["machines"]["bottom"], other
