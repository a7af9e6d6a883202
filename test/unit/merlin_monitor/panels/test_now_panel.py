# SPDX-License-Identifier: Apache-2.0
"""The panels of the present and of the queue: what is said of a request, whichever topic is heard first."""

from itertools import permutations
from typing import Any, Callable, Dict, List, Tuple

import pytest
from merlin_msgs.msg import ExecutorStatus, GoalQueue, QueuedGoal
from messages import Reported, ended, executor

from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import CHECKS
from merlin_monitor.panels.now import NowPanel, QueuePanel
from merlin_monitor.state.inbox import DirectInbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.state.plan_section import OVERTAKEN

REQUEST, GOAL = "/mission-1-12.5", "(checked kitchen)"


class System(RosSystem):
    """What the panels ask, without ROS."""

    namespace = "/"

    def __init__(self) -> None:
        self.receivers: Dict[str, Callable[[Any], object]] = {}
        self.now = 10.0

    def parameter(self, name: str, default: Any = None) -> Any:
        return default

    def time(self) -> float:
        return self.now

    wall = time

    def time_of(self, message: Any) -> float:
        return self.now

    def subscribe(self, topic: str, message_class: type, receive: Any, **_: Any) -> Any:
        self.receivers[topic] = receive
        return self

    def send(self, topic: str, message: Any) -> None:
        self.receivers[f"merlin/{topic}"](message)


class Said(Reported):
    """The panels, and what they report."""

    def __init__(self) -> None:
        super().__init__()
        self.system = System()
        state = MonitorModel(DirectInbox())
        state.on_event = self
        self.tree = state.tree
        self.panel = NowPanel(state, self.system)
        self.other = QueuePanel(state, self.system)

    def check(self) -> List[str]:
        self.panel.check(self.system.time(), self.system.silence_clock())
        return self.texts


def heard(topic: str) -> Any:
    """A message about the request."""
    if topic == "queue":
        return GoalQueue(requests=[QueuedGoal(request=REQUEST, goals=[GOAL])])
    if topic == "status":
        return executor(ExecutorStatus.RUNNING, request=REQUEST, goals=[GOAL])
    return ended(REQUEST, "cancelled")


@pytest.mark.parametrize(
    "topics", [*permutations(["queue", "execute/result"]), *permutations(["status", "execute/result"])]
)
def test_the_end_of_a_request_says_what_was_asked_for(topics: Tuple[str, str]) -> None:
    said = Said()
    for topic in topics:
        said.system.send(topic, heard(topic))
    assert said.check()[-1] == "“kitchen checked”: cancelled after 0.0 s"
    assert said.tree.get("queue", "ended")[0]["goals"] == [GOAL] == said.tree.get("now", "last", "goals")


def test_the_end_of_a_request_that_nothing_names_is_said_a_little_later() -> None:
    said = Said()
    said.system.send("execute/result", ended(REQUEST, "refused"))
    assert said.check() == []
    for _ in range(round(OVERTAKEN / CHECKS)):
        said.system.now += CHECKS
        said.check()
    assert said.texts == ["“a request”: refused after 0.0 s"]
    assert said.check() == said.texts and said[0].at == 10.0


@pytest.mark.parametrize("topic", ["queue", "status"])
def test_a_monitor_that_hangs_still_says_what_was_asked_for(topic: str) -> None:
    said = Said()
    said.system.send("execute/result", heard("execute/result"))
    said.system.now += 3600.0  # it is looked at the end first, then at what waits to be read
    assert said.check() == []
    said.system.send(topic, heard(topic))
    assert said.check()[-1].startswith("“kitchen checked”: cancelled")
