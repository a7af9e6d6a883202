# SPDX-License-Identifier: Apache-2.0
"""The panel of the state machines: every SMACH introspection server there is, ours or the original's."""

from functools import partial
from typing import Any, Dict, List, Set

from merlin_msgs.msg import MachineHolds, StateOutcome
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure
from std_msgs.msg import String

from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.actions.peers import sender_of
from merlin_ros.publishing import publish
from merlin_sm.holding.node_holds import CONSOLES_TOPIC, HOLDS_TOPIC, OUTCOMES_TOPIC

STATUS = "/smach/container_status"
STRUCTURE = "/smach/container_structure"
FOLLOW_PERIOD = 1.0  # s of wall time between two words to the nodes that may hold machines


class MachinesPanel(Panel):
    """The machines of the servers below the monitor's namespace."""

    name, title, place, width = "machines", "State machines", 50, 12

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._namespace = self.ros.namespace
        self._servers: Dict[str, List[Any]] = {}
        self._nodes: Dict[str, Set[str]] = {}  # server → nodes that have one of this name
        self._holders: Set[str] = set()  # nodes that may hold machines
        self._followed_at = float("-inf")
        self._consoles = self.ros.publisher(CONSOLES_TOPIC, String)
        self.subscribe(HOLDS_TOPIC, MachineHolds, self._take_holds)
        self.subscribe(OUTCOMES_TOPIC, StateOutcome, self.state.machines.outcome)

    def check(self, at: float, wall: float) -> None:
        """Marks silent machines; a paused simulation is not a silence. Says that it follows holds."""
        simulator = self.state.tree.get("meta", "simulator") or {}
        self.state.machines.check_silence(wall, bool(simulator.get("paused")))
        if self.state.machines.check_holds(wall):
            self.state.now.refresh()
        if self.state.machines.may_be_held and wall - self._followed_at >= FOLLOW_PERIOD:
            self._followed_at = wall
            publish(self._consoles, String(self.ros.name))

    def look(self, topics: Dict[str, str]) -> None:
        """Notices servers that appear and vanish; called by one thread."""
        found = {
            topic[: -len(STATUS)]
            for topic, kind in topics.items()
            if kind == SmachContainerStatus._type
            and topic.endswith(STATUS)
            and topic.startswith(self._namespace)
        }
        for server in found - set(self._servers):
            self._servers[server] = [
                # The structure first: a status means more beside it.
                self.subscribe(
                    server + STRUCTURE,
                    SmachContainerStructure,
                    partial(self._structure, server),
                    queue_size=1000,
                ),
                self.subscribe(
                    server + STATUS, SmachContainerStatus, partial(self._status, server), queue_size=1000
                ),
            ]
        for server in set(self._servers) - found:
            for subscriber in self._servers.pop(server):
                subscriber.unregister()
        nodes = {server: set(self.ros.publishers_of(server + STATUS)) for server in found}
        for server, known in self._nodes.items():
            for node in known - nodes.get(server, set()):
                self.state.inbox.put(self.state.machines.server_gone, server, node)
        self._nodes = nodes
        holders = set(self.ros.publishers_of(self.ros.resolve(HOLDS_TOPIC)))
        for node in self._holders - holders:
            self.state.inbox.put(self._forget_holds, node)
        self._holders = holders

    def _take_holds(self, message: MachineHolds, at: float) -> None:
        self.state.machines.holds(message, at, self.ros.silence_clock())
        self.state.now.refresh()

    def _forget_holds(self, node: str) -> None:
        self.state.machines.forget_holds(node)
        self.state.now.refresh()

    def _structure(self, server: str, message: SmachContainerStructure, at: float) -> None:
        self.state.machines.structure(server, message, self.ros.silence_clock(), sender_of(message))

    def _status(self, server: str, message: SmachContainerStatus, at: float) -> None:
        self.state.machines.status(server, message, at, self.ros.silence_clock(), sender_of(message))
        self.state.now.refresh()
