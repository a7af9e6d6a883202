"""The panel of the state machines: every SMACH introspection server there is, ours or the original's."""

import time
from typing import Dict, List

import rospy
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.state.monitor_model import MonitorModel

STATUS = "/smach/container_status"
STRUCTURE = "/smach/container_structure"


class MachinesPanel(Panel):
    """The machines of the servers below the monitor's namespace."""

    name, title, place, width = "machines", "State machines", 50, 8

    def __init__(self, state: MonitorModel, watch: GraphWatch) -> None:
        super().__init__(state, watch)
        self._namespace = rospy.get_namespace().rstrip("/") + "/"
        self._servers: Dict[str, List[rospy.Subscriber]] = {}

    def check(self, at: float, wall: float) -> None:
        """Marks silent machines; a paused simulation is not a silence."""
        simulator = self.state.tree.get("meta", "simulator") or {}
        self.state.machines.check_silence(wall, bool(simulator.get("paused")))

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
                rospy.Subscriber(
                    server + STRUCTURE, SmachContainerStructure, self._structure, server, queue_size=1000
                ),
                rospy.Subscriber(
                    server + STATUS,
                    SmachContainerStatus,
                    self._status,
                    server,
                    queue_size=1000,
                    tcp_nodelay=True,
                ),
            ]
        for server in set(self._servers) - found:
            for subscriber in self._servers.pop(server):
                subscriber.unregister()
            self.state.inbox.put(self.state.machines.server_gone, server)

    def _structure(self, message: SmachContainerStructure, server: str) -> None:
        self.state.inbox.put(self.state.machines.structure, server, message, time.monotonic())

    def _status(self, message: SmachContainerStatus, server: str) -> None:
        at = message.header.stamp.to_sec() or rospy.get_time()
        self.state.inbox.put(self._take, server, message, at, time.monotonic())

    def _take(self, server: str, message: SmachContainerStatus, at: float, wall: float) -> None:
        self.state.machines.status(server, message, at, wall)
        self.state.now.refresh()
