# SPDX-License-Identifier: Apache-2.0
"""A node that hangs soon after it has begun is noticed; one that reports now and then is not silent."""

import threading
from typing import Any, Callable, List, Set

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from merlin_msgs.msg import GuardStatus
from messages import Reported

from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import CHECKS
from merlin_monitor.panels.health import MOST_HANGING, GuardPanel, HealthPanel
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.health_section import FIRST_PERIOD, PERIODS, SILENT_AFTER
from merlin_monitor.state.inbox import DirectInbox, Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_test import LONG

NODE = "/navigation"
#: s after which a part that has reported once is silent.
LATE = max(SILENT_AFTER, PERIODS * FIRST_PERIOD) + 0.1


class System(RosSystem):
    """Topics without ROS; which nodes hang, a test says."""

    def __init__(self) -> None:
        self.now = 0.0
        self.silence_clock()
        self.hanging: Set[str] = set()
        self.asked: List[str] = []

    def subscribe(self, topic: str, message_class: type, receive: Callable[[Any], object], **_: Any) -> Any:
        self.resolved_name, self.receive = topic, receive
        return self

    def wall(self) -> float:
        return self.now

    def time_of(self, message: Any) -> float:
        return self.now

    def hangs(self, node: str) -> bool:
        self.asked.append(node)
        return node in self.hanging


class Robot:
    """A panel of the health, and nodes that report."""

    def __init__(self) -> None:
        self.system, inbox = System(), Inbox()
        self.state = MonitorModel(inbox)
        self.panel = HealthPanel(self.state, self.system)
        self.stop = inbox.stop
        inbox.start()

    def reports(self, wall: float, node: str = NODE) -> None:
        while self.system.now < wall:  # as it is looked at
            self.system.now = min(wall, self.system.now + CHECKS)
            self.system.silence_clock()
        message = DiagnosticArray(status=[DiagnosticStatus(name=f"{node.strip('/')}: part")])
        message._connection_header = {"callerid": node}
        self.system.receive(message)

    def silent(self, wall: float) -> List[str]:
        """What is silent after a check, a look and the next check."""
        self.check(wall)
        self.panel.look({})
        self.check(wall)
        return self.state.health.silent_nodes()

    def check(self, wall: float) -> None:
        taken = threading.Event()
        self.state.inbox.put(self.panel.check, wall, wall)
        self.state.inbox.put(self.state.freshness.check, wall, {}, {"navigation": Source(True, NODE)})
        self.state.inbox.put(self.state.now.refresh)
        self.state.inbox.put(taken.set)
        assert taken.wait(LONG)


@pytest.fixture
def robot() -> Any:
    robot = Robot()
    yield robot
    robot.stop()


@pytest.mark.parametrize("reports", [1, 2])
def test_a_node_that_hangs_after_its_first_reports_is_named(robot: Robot, reports: int) -> None:
    for second in range(reports):
        robot.reports(float(second))
    robot.system.hanging.add(NODE)
    assert robot.silent(reports + 0.1) == [] and robot.system.asked == [], "it may still report"
    assert robot.silent(reports + LATE) == ["navigation"]
    robot.check(reports + LATE)
    assert robot.state.tree.get("now", "trouble") == ["the navigation server (navigation) does not answer"]
    robot.system.hanging.clear()
    robot.reports(reports + LATE)
    assert robot.silent(reports + LATE) == []


def test_a_node_that_reports_now_and_then_answers(robot: Robot) -> None:
    robot.reports(0.0)
    assert robot.silent(LATE) == [] and robot.system.asked == [NODE]
    # Nor is one asked of which it is known how often it reports.
    for second in range(3):
        robot.reports(LATE + second)
    robot.system.asked.clear()
    assert robot.silent(2 * LATE + 3) == ["navigation"] and robot.system.asked == []


def test_many_that_hang_hold_a_look_up_for_some_seconds_only(robot: Robot) -> None:
    nodes = [f"/node_{number}" for number in range(20)]
    for node in nodes:
        robot.reports(0.0, node)
    robot.system.hanging.update(nodes)
    assert len(robot.silent(LATE)) == MOST_HANGING == len(robot.system.asked)


def test_what_a_monitor_that_hangs_has_missed_is_not_silence() -> None:
    system, said = System(), Reported()
    state = MonitorModel(DirectInbox())
    state.on_event = said
    panel = GuardPanel(state, system)
    system.receive(GuardStatus())
    system.now += 3600.0  # it looks at the clock first, then at what waits to be read
    panel.check(system.now, system.silence_clock())
    assert state.tree.get("guard", "state") == "idle" and said.texts == []
    for _ in range(4):
        system.now += CHECKS
        panel.check(system.now, system.silence_clock())
    assert state.tree.get("guard", "state") == "silent"
