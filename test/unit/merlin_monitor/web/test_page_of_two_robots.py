# SPDX-License-Identifier: Apache-2.0
"""Stop and Release of the page reach the guard of each robot, also of one that joins; with real guards."""

import json
import signal
import urllib.request
from pathlib import Path
from typing import Any, Dict

import pytest
from merlin_msgs.msg import GuardStatus
from shown_page import Visit, chromium

from merlin_monitor.access.operators import write_operators
from merlin_test import LONG
from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

TOKEN = "token of the test"

# Prints what the guard of a robot says, when it changes.
WITNESS = """
import sys, rospy
from merlin_msgs.msg import GuardStatus
from merlin_test.topic_links import init_node
from merlin_test import LONG
init_node("witness", anonymous=True)
last = []
def told(status):
    said = [status.state, status.reason]
    if said != last:
        last[:] = said
        print("guard", *said, flush=True)
rospy.Subscriber(f"/{sys.argv[1]}/merlin/guard", GuardStatus, told)
rospy.spin()
"""


class Robots:
    """Guards of robots, and what they say."""

    def __init__(self, master: Any) -> None:
        self._master = master
        self.witnesses: Dict[str, Any] = {}
        self.guards: Dict[str, Any] = {}

    def start(self, robot: str) -> None:
        self.witnesses[robot] = self._master.node(WITNESS, robot)
        self.guards[robot] = self._master.spawn(node_path("merlin_guard", "guard"), f"__ns:=/{robot}")

    def wait_known(self, visit: Visit, address: str) -> None:
        """Waits until the monitor has heard all guards."""
        for _ in range(int(10 * LONG)):
            if len(state(address).get("guard", {}).get("robots", {})) == len(self.guards):
                return
            visit.page.wait_for_timeout(100)
        raise AssertionError(state(address).get("guard"))

    def held(self, robot: str, by: str) -> None:
        self.witnesses[robot].expect(f"guard {GuardStatus.STOPPED} stopped by {by}")

    def free(self, robot: str) -> None:
        self.witnesses[robot].expect(f"guard {GuardStatus.IDLE}")


@pytest.fixture
def robots(master: Any) -> Robots:
    found = Robots(master)
    for robot in ("ria", "tom"):
        found.start(robot)
        found.witnesses[robot].expect("guard ")
    return found


@pytest.fixture
def address(master: Any, tmp_path: Path) -> str:
    operators = tmp_path / "operators.yaml"
    write_operators(operators, {"Ana": TOKEN})
    master.api.setParam("/test", "/monitor/port", 0)
    master.api.setParam("/test", "/monitor/operators", str(operators))
    monitor = master.spawn(node_path("merlin_monitor", "monitor"), "__name:=monitor", "_history:=")
    return str(monitor.expect("monitor: http").split(" ", 1)[1])


def state(address: str) -> Dict[str, Any]:
    with urllib.request.urlopen(f"{address}state.json", timeout=LONG) as answer:
        return json.load(answer)["state"]


def sign_in(visit: Visit) -> None:
    visit.page.click("#operator")
    visit.page.fill("#token", TOKEN)
    visit.page.keyboard.press("Enter")
    visit.wait_text("#operator", "Ana")


def test_a_stop_and_its_release_reach_each_robot_and_one_that_joins(robots: Robots, address: str) -> None:
    with chromium() as browser:
        visit = Visit(browser, address)
        robots.wait_known(visit, address)
        visit.page.click("#stop")  # no token is needed
        visit.wait_text("#control-said", "ria held, tom held")
        for robot in ("ria", "tom"):
            robots.held(robot, "a visitor at 127.0.0.1")
        visit.wait_text("#now-doing", "tom stopped and held by a visitor at 127.0.0.1")
        robots.start("uwe")  # joins while the stop stands
        robots.held("uwe", "a visitor at 127.0.0.1")
        visit.wait_text("#guard-robots", "uwe: stopped and held by a visitor")
        sign_in(visit)
        visit.page.click("#release")
        visit.wait_text("#confirm-said", "robot ria is held by a visitor at 127.0.0.1 since")
        visit.page.click("#confirm-yes")
        visit.wait_text("#control-said", "ria may drive again, tom may drive again, uwe may drive again")
        for robot in ("ria", "tom", "uwe"):
            robots.free(robot)
        visit.wait("() => document.getElementById('guard').hidden")
        assert visit.complaints == []
        visit.close()


def test_a_robot_that_does_not_confirm_is_named_and_held_as_soon_as_it_is_back(
    robots: Robots, address: str
) -> None:
    with chromium() as browser:
        visit = Visit(browser, address)
        sign_in(visit)
        robots.wait_known(visit, address)
        robots.guards["tom"].send(signal.SIGSTOP)
        visit.page.click("#stop")
        visit.wait_text("#control-said[data-bad]", "ria held, tom NOT confirmed to be held")
        robots.held("ria", "Ana")
        visit.wait_text("#guard-robots", "tom: The base is not watched")
        robots.guards["tom"].send(signal.SIGCONT)
        robots.held("tom", "Ana")
        visit.wait_text("#control-said:not([data-bad])", "ria held, tom held")
        visit.page.click("#release")
        visit.wait_text("#control-said", "ria may drive again, tom may drive again")
        for robot in ("ria", "tom"):
            robots.free(robot)
        visit.close()
