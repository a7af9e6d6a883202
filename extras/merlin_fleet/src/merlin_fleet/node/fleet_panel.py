# SPDX-License-Identifier: Apache-2.0
"""The monitor's panel of the fleet: robots, goals, owners, leases, links."""

import threading
from typing import Any, Dict, Optional

import rospy

from merlin_fleet.certified import Tls
from merlin_fleet.fleet_client import DEFAULT_FLEET, FleetClient, FleetError
from merlin_fleet.fleet_shown import shown
from merlin_fleet.hub import DEFAULT_ENDPOINT
from merlin_fleet.node.fleet_parameters import listed
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_ros.master.master_link import ERRORS, bounded_master

NODE = "merlin_fleet"  # the robot's part in the fleet: its parameters name the hub


class FleetPanel(Panel):
    """Follows the hub of this robot's fleet, with the robot's certificate; hidden without a fleet."""

    name, title, place = "fleet", "Fleet", 45
    script = "package://merlin_fleet/web/fleet.js"

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._node = rospy.resolve_name(NODE)
        self._client: Optional[FleetClient] = None
        self._parameters: Dict[str, Any] = {}  # of the client
        self._changed = threading.Event()  # set in the hub's thread, cleared in the model's
        rospy.on_shutdown(self._close)

    def look(self, topics: Dict[str, str]) -> None:
        """Connects when the robot's part in the fleet has its parameters, and anew when it has others."""
        try:
            found = bounded_master().getParam(self._node)
            if isinstance(found, dict) and "fleet" in found and found != self._parameters:
                self._close()
                self._client, self._parameters = _client(found, self._changed.set), found
        except ERRORS:  # the master is gone, or has no such parameters: the next look sees
            return
        except FleetError as error:
            self.state.inbox.put(self.set, "missing", str(error))

    def check(self, at: float, wall: float) -> None:
        """Shows what has changed."""
        client = self._client
        if client is not None and self._changed.is_set():
            self._changed.clear()
            for part, value in shown(client).items():
                self.set(part, value)

    def _close(self) -> None:
        client, self._client, self._parameters = self._client, None, {}
        if client is not None:
            client.close()


def _client(parameters: Dict[str, Any], on_change: Any) -> FleetClient:
    """A client of the fleet that the robot's node names in its parameters."""
    hub = parameters.get("hub") or DEFAULT_ENDPOINT
    endpoints = listed(hub) or (str(hub),)
    files = Tls(*(str(parameters.get(field) or "") for field in Tls._fields))
    tls = files if all(files) else None
    fleet = str(parameters["fleet"] or DEFAULT_FLEET)
    return FleetClient(fleet, endpoints, tls, on_change)
