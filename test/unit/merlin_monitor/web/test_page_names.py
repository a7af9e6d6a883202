# SPDX-License-Identifier: Apache-2.0
"""The page assumes nothing about names: of states, machines, robots, things; nor about where a map lies."""

import math
from typing import Any, List

import pytest
from geometry_msgs.msg import Quaternion
from merlin_msgs.msg import MachineHolds
from messages import status, structure
from nav_msgs.msg import OccupancyGrid
from served import TOKEN, Served
from shown_page import signed_in

pytestmark = pytest.mark.processes

#: What every object of JavaScript has.
OF_OBJECTS = ("constructor", "__proto__", "toString", "hasOwnProperty")


def machine(served: Served, server: str, path: str, *labels: str, node: str = "", running: str = "") -> None:
    """A node shows a machine of states that follow each other."""
    edges = [("ok", label, after) for label, after in zip(labels, [*labels[1:], "None"])]
    put, machines = served.state.inbox.put, served.state.machines
    of = [node] if node else []
    put(machines.structure, server, structure(path, list(labels), edges, ["ok"]), 0.0, *of)
    for active in ([], [running] if running else []):
        put(machines.status, server, status(path, *active, info="START"), 100.0, 0.0, *of)


def names(page: Any) -> List[str]:
    """Of the machines, without the glyph."""
    return [text[2:] for text in page.texts(".machine .name")]


def drawn(page: Any, name: str) -> Any:
    """The picture of a machine, unfolded."""
    box = page.page.locator(".machine").filter(has=page.page.get_by_role("button", name=name))
    box.locator(".cluster-text").first.wait_for()
    return box


def test_a_machine_of_any_path_is_one_machine(visits: Any, served: Served) -> None:
    page = visits()
    for path in ("/", "SM_ROOT", "/SM_ROOT"):
        page.wait("() => document.querySelectorAll('.machine').length === 3")
        a_machine_is_one_machine(page, served, path)
        served.state.inbox.put(served.state.machines.server_gone, "/srv", "")


def a_machine_is_one_machine(page: Any, served: Served, path: str) -> None:
    inner = f"{path.rstrip('/')}/SUB"
    machine(served, "/srv", path, "SUB", "LAST", running="SUB")
    machine(served, "/srv", inner, "X", "[a/b]", running="[a/b]")
    machine(served, "/srv", f"{inner}/[a/b]", "DEEP", running="DEEP")
    page.wait_text(".machine .where", "▶ SUB / [a/b] / DEEP")
    name = path.strip("/") or "/srv"
    assert sorted(names(page)) == sorted([name, "NAVIGATE", "ASK", "TAKE_ORDER"])
    box = drawn(page, name)
    page.wait("() => document.querySelectorAll('.machine .cluster.active').length >= 3")
    box.locator(".cluster-text").nth(2).wait_for(state="attached")  # the whole drawing, of all messages
    assert box.locator(".cluster-text").all_text_contents() == [path.strip("/") or "/", "SUB", "[a/b]"]
    frames = [each.bounding_box() for each in box.locator("rect.cluster").all()]
    for outer, inner_box in zip(frames, frames[1:]):
        assert outer["y"] < inner_box["y"] and outer["height"] > inner_box["height"], "one inside the other"
    box.locator(".node", has_text="DEEP").click()
    page.wait_text("#userdata .title", f"{inner if inner.startswith('/') else f'/{inner}'}/[a/b]")


def test_machines_of_one_path_are_told_apart_and_fold_one_by_one(visits: Any, served: Served) -> None:
    page = visits()
    machine(served, "/one", "/SM_ROOT", "A", "B", node="/here")
    machine(served, "/two", "/SM_ROOT", "C", "D", node="/here")
    for node in ("/here", "/there"):  # as whoever copies a tutorial twice
        machine(served, "/server_name", "/SM", "E", "F", node=node)
    wanted = {"SM_ROOT · /one", "SM_ROOT · /two", "SM · /server_name · /here", "SM · /server_name · /there"}
    page.wait_text(".machine .name", "SM · /server_name · /there")
    assert wanted < set(names(page))
    for name, states in (("SM_ROOT · /two", ["C", "D"]), ("SM · /server_name · /there", ["E", "F"])):
        before = page.page.locator(".machine:not(.folded)").count()
        page.page.locator(".machine .name", has_text=name).click()
        drawn(page, name)
        assert page.page.locator(".machine:not(.folded)").count() == before + 1
        shown = page.page.locator(".machine", has=page.page.get_by_role("button", name=name))
        assert shown.locator(".node.state text:not(.glyph)").all_text_contents() == states
    # Each has its own state, and what a node holds is of its machine.
    put, machines = served.state.inbox.put, served.state.machines
    put(machines.status, "/server_name", status("/SM", "F"), 101.0, 1.0, "/there")
    put(machines.holds, MachineHolds(node="/there", held=["SM/E"]), 101.0, 1.0)
    page.wait_text(".machine:has(.node.active) .name", "/there")
    for node, glyphs in (("/here", 0), ("/there", 1)):
        box = page.page.locator(".machine").filter(has=page.page.get_by_role("button", name=node))
        if node == "/here":
            box = page.page.locator(".machine", has_text="SM · /server_name · /here")
            box.locator(".name").click()
            box.locator(".node.state").first.wait_for()
        assert box.locator(".glyph", has_text="⏸").count() == glyphs, node
    put(machines.server_gone, "/server_name", "/there")
    page.wait(
        "() => [...document.querySelectorAll('.machine .name')].every((e) => !/there/.test(e.textContent))"
    )
    assert "SM" in names(page), "where there is one only, it needs no more"


def test_names_of_javascript_are_names_as_others(visits: Any, served: Served) -> None:
    page = visits("?lang=de")
    tree = served.state.tree
    for name in OF_OBJECTS:
        machine(served, f"/{name}", f"/{name}", *OF_OBJECTS, running=name)
    page.wait("() => document.querySelectorAll('.machine .node.active').length === 4 + 1")
    assert set(OF_OBJECTS) < set(names(page))
    # No robot is called so: the plan's steps are none's.
    steps = {
        name: {**tree.get("plan", "steps", "0"), "text": f"(go {name})", "name": name} for name in OF_OBJECTS
    }
    for name, step in steps.items():
        step.update(parameters=[["to", name]], words={"action": name, "with": {"to": name}, "english": name})
    tree.set(
        "robots", {"parameters": dict.fromkeys(OF_OBJECTS, "to"), "robots": {"ria": {"does": ["toString"]}}}
    )
    tree.set("plan", "order", [*OF_OBJECTS, "valueOf"])
    tree.set("plan", "steps", steps)
    page.wait("() => document.querySelectorAll('#plan-steps li').length === 4")
    page.wait_text("#robots-list .does", "toString")
    assert page.texts(".gantt .robot") == []
    # A sentence has blanks of its own only.
    served.state.inbox.put(lambda: tree.set("guard", {"state": "holding", "reason": "held by {toString}"}))
    page.wait_text("#guard-says", "held by {toString}")
    # Facts, points and what can be asked for there.
    domain = {
        "name": "odd",
        "types": {"constructor": "object"},
        "predicates": {"toString": [["p", "constructor"]]},
        "operators": {"valueOf": [["p", "constructor"]]},
        "adds": {"valueOf": [["toString", "p"], ["hasOwnProperty", "toString"]], "toString": [["is", "p"]]},
    }
    tree.set("knowledge", "domain", domain)
    tree.set("knowledge", "objects", {name: {"type": "constructor"} for name in OF_OBJECTS})
    tree.set("knowledge", "facts", {name: {} for name in OF_OBJECTS})
    tree.set("map", "points", {name: [1.0, 1.0 + 0.5 * at, 0.0] for at, name in enumerate(OF_OBJECTS)})
    page.wait_text("#map-picture .map-point", "constructor")
    page.wait_text("#knowledge-list", "hasOwnProperty")
    page.page.locator(".map-point", has_text="toString").click()
    assert page.texts("#place-list button") == ["toString toString"]
    page.page.keyboard.press("Escape")
    signed_in(page)
    page.page.fill("#goal", "(toString ")
    page.wait("() => document.querySelectorAll('#goal-choices li').length === 4")
    page.page.fill("#goal", "(toString constructor) (valueOf ")
    page.page.click("#goal")
    assert page.page.locator("#goal-choices li").count() == 0


def grid(yaw: float = 0.0, x: float = 1.0, **fields: float) -> OccupancyGrid:
    """4 x 2 m from (1, 2) on, of which one corner cell is occupied."""
    message = OccupancyGrid(data=[100] + [0] * 7)
    message.info.width, message.info.height = 4, 2
    message.info.resolution = fields.get("resolution", 1.0)
    message.info.origin.position.x, message.info.origin.position.y = x, 2.0
    message.info.origin.orientation = Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    return message


def test_a_turned_map_is_drawn_turned_and_one_without_sense_is_named(visits: Any, served: Served) -> None:
    page = visits()
    put, section = served.state.inbox.put, served.state.map
    put(section.grid, grid(math.pi / 2))
    view = "document.querySelector('#map-picture > svg').viewBox.baseVal"
    page.wait(f"() => {view}.width === 2")
    # It lies from (-1, 2) to (1, 6): y grows upwards.
    shown = page.page.evaluate(f"(({{ x, y, width, height }}) => [x, y, width, height])({view})")
    assert shown == pytest.approx([-1.0, -6.0, 2.0, 4.0])
    corner = page.page.evaluate(
        "() => { const image = document.querySelector('#map-picture image'), root = image.ownerSVGElement;"
        " const turn = root.getScreenCTM().inverse().multiply(image.getScreenCTM());"
        " const at = new DOMPoint(0, 0).matrixTransform(turn);"
        " return [at.x, at.y]; }"
    )
    assert corner == pytest.approx([1.0, -2.0]), "its origin, about which it is turned"
    put(section.grid, grid(x=math.nan))
    page.wait_text("#map-why", "the map cannot be drawn: its origin is at nan, 2 m")
    assert page.page.locator("#map-picture image").is_hidden()
    assert page.page.locator("#map-picture .map-point").count() == 4, "what else is known stays"
    put(section.grid, grid())
    page.wait(f"() => {view}.width === 4")
    assert page.page.locator("#map-why").is_hidden()


def test_why_a_saved_token_counts_no_more_is_said(visits: Any, served: Served) -> None:
    page = visits()
    page.page.click("#operator")
    page.page.fill("#token", TOKEN)
    page.page.keyboard.press("Enter")
    page.wait_text("#operator", "Ana")
    served.operators.write_text('ana: "another token than before"\n')
    page.page.reload()
    page.wait_text("#control-said", "The token is not the right one.")
    page.wait_text("#operator", "Sign in")
