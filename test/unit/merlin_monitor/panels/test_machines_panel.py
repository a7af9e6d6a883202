# SPDX-License-Identifier: Apache-2.0
"""The panel of the state machines: nodes that use one name of a server, as they come and go. Without ROS."""

import threading
from typing import Any, Callable, Dict, Iterator, List, Tuple

import pytest
from merlin_msgs.msg import MachineHolds
from messages import status, structure

from merlin_monitor.listeners.ros_system import RosSystem, TopicGraph
from merlin_monitor.panels.machines import STATUS, STRUCTURE, MachinesPanel
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_sm.holding.node_holds import HOLDS_TOPIC
from merlin_test import LONG


class System(RosSystem):
    """What the panel asks, without ROS."""

    namespace = "/"

    def __init__(self) -> None:
        self.receivers: Dict[str, Callable[[Any], object]] = {}
        self.nodes: List[str] = []
        self.holders: List[str] = []

    def time(self) -> float:
        return 1.0

    def subscribe(self, topic: str, message_class: type, receive: Any, **_: Any) -> Any:
        self.receivers[topic] = receive
        return self

    def publisher(self, topic: str, message_class: type) -> Any:
        return self

    def unregister(self) -> None:
        pass

    def graph(self) -> TopicGraph:
        topics = {f"/srv{STATUS}": "smach_msgs/SmachContainerStatus"} if self.nodes else {}
        publishers = {**dict.fromkeys(topics, self.nodes), self.resolve(HOLDS_TOPIC): self.holders}
        return TopicGraph(publishers, topics)

    def resolve(self, name: str) -> str:
        return f"/{name}"

    def send(self, topic: str, message: Any, node: str) -> None:
        message._connection_header = {"callerid": node}
        self.receivers[topic](message)


@pytest.fixture
def panel() -> Iterator[Tuple[MachinesPanel, System]]:
    system, inbox = System(), Inbox()
    made = MachinesPanel(MonitorModel(inbox), system)
    inbox.start()
    yield made, system
    inbox.stop()


def shown(panel: MachinesPanel) -> Dict[str, List[str]]:
    """The active states of the machines, by their nodes."""
    taken = threading.Event()
    panel.state.inbox.put(taken.set)
    assert taken.wait(LONG)
    containers = panel.state.tree.get("machines", "containers")
    return {each["node"]: each.get("active", []) for each in containers.values()}


def test_machines_of_nodes_with_one_name_of_a_server_come_and_go_one_by_one(panel: Any) -> None:
    made, system = panel
    system.nodes = ["/here", "/there"]
    made.look(system.look() or {})
    for node, state in (("/here", "A"), ("/there", "B")):
        machine = structure("/SM_ROOT", ["A", "B"], [("ok", "A", "B"), ("ok", "B", "None")], ["ok"])
        system.send(f"/srv{STRUCTURE}", machine, node)
        system.send(f"/srv{STATUS}", status("/SM_ROOT", state), node)
    assert shown(made) == {"/here": ["A"], "/there": ["B"]}
    system.nodes = ["/there"]
    made.look(system.look() or {})
    assert shown(made) == {"/there": ["B"]}
    system.nodes = []
    made.look(system.look() or {})
    assert shown(made) == {}


def test_breakpoints_and_levels_of_a_node_that_has_ended_are_forgotten(panel: Any) -> None:
    made, system = panel
    system.holders = ["/here", "/there"]
    made.look(system.look() or {})
    for node in system.holders:
        set_there = MachineHolds(node=node, breakpoints=["NAVIGATE/DRIVE"], autonomy="low")
        system.send(HOLDS_TOPIC, set_there, node)
    shown(made)
    assert list(made.state.tree.get("machines", "holds")) == ["/here", "/there"]
    for left in (["/there"], []):
        system.holders = left
        made.look(system.look() or {})
        shown(made)
        assert list(made.state.tree.get("machines", "holds")) == left
    assert not made.state.machines.may_be_held
