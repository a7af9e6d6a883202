# SPDX-License-Identifier: Apache-2.0
"""The robots of one plan: which of them does what, in the state, in lanes, on the map and in the terminal."""

from typing import Any, Iterator, Tuple

import pytest
from merlin_msgs.msg import DispatchStatus, RobotHost, RunningAction
from messages import Reported, dispatch, parameters
from rosplan_dispatch_msgs.msg import CompletePlan
from served import Served
from shown_page import NOW, Visit, chromium, show_panels
from sound_play.msg import SoundRequest

from merlin_monitor.history.pictures import Pictures
from merlin_monitor.panels.robots import SILENT, RobotsSection
from merlin_monitor.panels.said import SaidSection
from merlin_monitor.state.plan_steps import sequential_steps
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.terminal.terminal_view import lines

pytestmark = pytest.mark.processes


def word(robot: str, host: str = "host", **fields: Any) -> RobotHost:
    return RobotHost(
        robot=robot, node=f"/{robot}/{host}", operators=["drive"], robot_parameters=["r"], **fields
    )


def running(*drives: Tuple[str, str]) -> DispatchStatus:
    actions = [
        RunningAction(name="drive", parameters=parameters(("r", robot), ("to", to))) for robot, to in drives
    ]
    return DispatchStatus(running=actions)


@pytest.fixture
def reported() -> Reported:
    return Reported()


@pytest.fixture
def tree() -> StateTree:
    return StateTree()


@pytest.fixture
def section(tree: StateTree, reported: Reported) -> RobotsSection:
    section = RobotsSection(tree, reported)
    for robot in ("ann", "bob"):
        section.host(word(robot), 1.0, 10.0)
    return section


def test_each_robot_does_its_own(section: RobotsSection, tree: StateTree) -> None:
    section.dispatcher(running(("bob", "kitchen"), ("carl", "hall")), 2.0)
    assert tree.get("robots", "robots") == {
        "ann": {"away": "", "does": [], "words": []},
        "bob": {
            "away": "",
            "does": ["(drive bob kitchen)"],
            "words": [{"action": "drive kitchen", "english": "driving to kitchen"}],
        },
    }
    assert tree.get("robots", "parameters") == {"drive": "r"}


def test_a_word_that_no_host_can_have_said_names_no_robot(section: RobotsSection, tree: StateTree) -> None:
    section.host(RobotHost(), 1.0, 10.0)
    section.host(RobotHost(robot="carl", node="no name"), 1.0, 10.0)
    assert set(tree.get("robots", "robots")) == {"ann", "bob"}


def test_why_a_robot_takes_no_actions_is_reported_once(
    section: RobotsSection, tree: StateTree, reported: Reported
) -> None:
    def away(robot: str) -> str:
        return str(tree.get("robots", "robots", robot, "away"))

    for _ in range(2):
        section.host(word("ann", out="was taken out by its operator"), 2.0, 11.0)
    section.host(word("bob", leaving=True), 3.0, 11.0)
    assert (away("ann"), away("bob")) == ("was taken out by its operator", "its host has ended")
    section.host(word("ann"), 4.0, 11.0)
    section.host(word("bob"), 4.0, 11.0)
    section.host(word("bob", "other"), 4.0, 11.0)
    assert away("bob") == "two hosts say that they are it: /bob/host and /bob/other"
    section.check_silence(5.0, 11.0 + SILENT)
    section.host(word("ann"), 6.0, 12.0)
    section.check_silence(7.0, 12.0 + SILENT)
    assert (away("ann"), away("bob")) == ("", "its host is silent")
    assert reported.texts == [
        "robot ann takes no actions: was taken out by its operator",
        "robot bob takes no actions: its host has ended",
        "robot ann takes actions again",
        "robot bob takes actions again",
        "robot bob takes no actions: two hosts say that they are it: /bob/host and /bob/other",
        "robot bob takes no actions: its host is silent",
    ]


def test_a_late_word_of_a_host_that_was_restarted_or_has_ended_does_not_bring_its_robot_back(
    section: RobotsSection, reported: Reported
) -> None:
    section.host(word("ann", life="one"), 2.0, 11.0)
    section.host(word("ann", life="two"), 3.0, 11.1)
    section.host(word("ann", life="one", out="was taken out by its operator"), 3.0, 11.2)
    section.host(word("ann", life="two", leaving=True), 4.0, 11.3)
    section.host(word("ann", life="two"), 4.0, 11.4)
    assert reported.texts == ["robot ann takes no actions: its host has ended"]


def test_robots_that_a_node_names_without_end_are_not_all_shown(
    section: RobotsSection, tree: StateTree, reported: Reported
) -> None:
    for number in range(2000):
        ghost = word(f"ghost{number}", leaving=True)
        ghost._connection_header = {"callerid": "/flood"}
        ghost.operators = [f"o{number}"]
        section.host(ghost, 2.0, 11.0 + number)
    shown = tree.get("robots", "robots")
    assert len(shown) < 100 and {"ann", "bob", "ghost1999"} <= set(shown)
    assert len(tree.get("robots", "parameters")) <= 1000
    section.host(word("ann", out="was taken out by its operator"), 3.0, 3000.0)
    assert reported.texts[-1] == "robot ann takes no actions: was taken out by its operator"


def test_the_terminal_says_it(section: RobotsSection, tree: StateTree) -> None:
    section.dispatcher(running(("bob", "kitchen")), 2.0)
    section.host(word("ann", leaving=True), 3.0, 11.0)
    text = [line.text for line in lines(tree.snapshot()[1])]
    assert text[text.index("Robots") + 1 :][:2] == ["  ann: its host has ended", "  bob: driving to kitchen"]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


def test_the_page_has_lanes_for_each_robot_and_its_name_on_the_map(browser: Any, served: Served) -> None:
    show_panels(served)
    section = RobotsSection(served.state.tree, Reported())
    for robot in ("ann", "bob"):
        section.host(word(robot), 1.0, 10.0)
    drives = [("ann", "hall"), ("bob", "hall"), ("ann", "kitchen")]
    plan = CompletePlan(
        plan=[
            dispatch(number, "drive", ("r", robot), ("to", to), dispatch_time=10.0 * number, duration=30.0)
            for number, (robot, to) in enumerate(drives)
        ]
    )
    served.state.planned(*sequential_steps(plan), NOW)
    section.dispatcher(running(("bob", "hall")), NOW)
    served.state.map.robots({"ann": (1.0, 1.0, 0.0), "bob": (3.0, 1.0, 1.6)})
    served.state.map.track("ann").path([(1.0, 1.0), (2.0, 1.0)])
    served.state.map.track("ann").goal((2.0, 1.0, 0.0))
    said = SaidSection(served.state.tree, Pictures(), Reported())
    said.spoken(SoundRequest(sound=SoundRequest.SAY, arg="Hello."), NOW, "ann")
    said.seen(["cup"], NOW, "bob")
    page = Visit(browser, served.url)
    page.wait("() => document.querySelectorAll('.gantt .robot').length === 2")
    assert page.texts(".gantt .robot") == ["ann", "bob"]
    assert page.texts("#said-list .said") == ["bob: cup", "ann: Hello."]
    tops = page.page.evaluate(
        "() => [...document.querySelectorAll('#plan-time .planned')].map((bar) => +bar.getAttribute('y'))"
    )
    names = page.page.evaluate(
        "() => [...document.querySelectorAll('.gantt .robot')].map((name) => +name.getAttribute('y'))"
    )
    # Ann's drives overlap in time, so they have two lanes; both are above the name of bob.
    assert names[0] < tops[0] < tops[2] < names[1] < tops[1]
    assert page.texts(".map-robot text") == ["ann", "bob"]
    ways = page.page.evaluate(
        "() => [...document.querySelectorAll('g > .map-path')].map((way) => way.getAttribute('points'))"
    )
    goals = page.page.evaluate(
        "() => [...document.querySelectorAll('g > .map-goal')].map((goal) => goal.style.display)"
    )
    assert (ways, goals) == (["1,-1 2,-1", ""], ["", "none"])
    shown = page.texts("#robots-list li")
    assert shown[0].startswith("ann") and "waits" in shown[0]
    assert shown[1].startswith("bob") and "hall" in shown[1]
    assert page.complaints == []
    page.close()
