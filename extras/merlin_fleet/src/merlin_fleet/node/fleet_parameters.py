# SPDX-License-Identifier: Apache-2.0
"""The private parameters of a robot's node in a fleet, checked when they are read."""

from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import rospkg
import rospy

from merlin_fleet.certified import Tls
from merlin_fleet.core.agent import Rules
from merlin_fleet.core.records import RecordError, checked_name
from merlin_fleet.core.retention import Retention
from merlin_fleet.core.robot_lease import LeaseTimes
from merlin_fleet.fleet_client import DEFAULT_FLEET
from merlin_fleet.hub import DEFAULT_ENDPOINT
from merlin_ros.parameters import ParameterError, graph_name, number


class FleetParameters(NamedTuple):
    """What the parameters of the node ``fleet_robot`` say, checked."""

    endpoints: Tuple[str, ...]
    tls: Optional[Tls]
    fleet: str
    robot: str
    groups: Tuple[str, ...]
    capabilities: Tuple[str, ...]
    outbox: str
    rules: Rules
    priority: int
    battery: str
    """Topic of sensor_msgs/BatteryState; empty: the battery is not looked at."""
    battery_least: float
    """Share of its charge below which the robot takes nothing."""
    planner_command: str
    planning_time: float
    action_duration: float
    """s that an action without a duration counts."""
    goal_duration: float
    """s that a goal counts that cannot be planned while the robot is busy."""
    page: str
    """Address of the robot's own page for those who look at the fleet; empty: that of the monitor."""
    start_wait: float
    """s for the planning system to be there at start."""


def read_parameters() -> FleetParameters:
    """Reads them.

    :raises ParameterError: when one has a value that makes no sense.
    """
    robot = _text("~robot", rospy.get_namespace().strip("/").replace("/", ".") or "robot")
    fleet = _text("~fleet", DEFAULT_FLEET)
    lease = LeaseTimes()
    try:
        checked_name(robot, "parameter ~robot:")
        checked_name(fleet, "parameter ~fleet:")
        lease = lease._replace(
            ttl=number("~lease", lease.ttl, 1.0), stop_time=number("~stop_time", lease.stop_time, 0.0)
        ).checked()
    except (RecordError, ValueError) as error:
        raise ParameterError(str(error)) from None
    planner = graph_name("~planner_interface", "rosplan_planner_interface")
    return FleetParameters(
        endpoints=_names("~hub", [DEFAULT_ENDPOINT]),
        tls=_tls(),
        fleet=fleet,
        robot=robot,
        groups=_names("~groups", []),
        capabilities=_names("~capabilities", []),
        outbox=_text("~outbox", "")
        or str(Path(rospkg.get_ros_home()) / "merlin" / "fleet" / f"{fleet}.{robot}.sqlite"),
        rules=Rules(
            lease,
            facts=_facts(),
            fact_limit=number("~fact_limit", 60.0, lease.ttl + 3 * lease.renew_every),
            keep=Retention(
                number("~keep_hours", Retention().hours, 0.0),
                round(number("~keep_goals", Retention().goals, 0.0)),
            ),
        ),
        priority=round(number("~priority", 0.0, -1e6)),
        battery=_text("~battery", ""),
        battery_least=number("~battery_least", 0.2, 0.0),
        planner_command=_text("~planner_command", str(rospy.get_param(f"{planner}/planner_command", ""))),
        planning_time=number("~planning_time", 10.0, 0.1),
        action_duration=number("~action_duration", 10.0, 0.0),
        goal_duration=number("~goal_duration", 60.0, 0.0),
        page=_text("~page", ""),
        start_wait=number("~planning_system_wait", 30.0, 0.0),
    )


def _text(name: str, default: str) -> str:
    value = rospy.get_param(name, default)
    if not isinstance(value, str):
        raise ParameterError(f"parameter {name} is {value!r}, not a text")
    return value or default


def _names(name: str, default: List[str]) -> Tuple[str, ...]:
    """A list, or a text with commas, as an argument of a launch file is one."""
    value = rospy.get_param(name, default)
    names = listed(value)
    if names is None:
        raise ParameterError(f"parameter {name} is {value!r}, not a list of names")
    return names or tuple(default)


def listed(value: Any) -> Optional[Tuple[str, ...]]:
    """The names of a list, or of a text with commas; None: it is neither."""
    if isinstance(value, str):
        text = value.strip()
        # Brackets around all of it: those of [::1]:2379 belong to the address.
        inner = text[1:-1] if text.startswith("[") and text.endswith("]") else text
        value = [part.strip() for part in inner.split(",")]
    if not isinstance(value, list) or not all(isinstance(part, str) for part in value):
        return None
    return tuple(part for part in value if part)


def _facts() -> Dict[str, str]:
    """Texts `predicate=robot`."""
    writers: Dict[str, str] = {}
    for text in _names("~fleet_facts", []):
        predicate, _, writer = (part.strip() for part in text.partition("="))
        try:
            checked_name(predicate, "the predicate")
            checked_name(writer, f"the robot that writes '{predicate}',")
        except RecordError as error:
            raise ParameterError(f"parameter ~fleet_facts: {error}; write door_open=ann") from None
        if writers.setdefault(predicate.lower(), writer) != writer:
            raise ParameterError(f"parameter ~fleet_facts: '{predicate}' has two writers")
    return writers


def _tls() -> Optional[Tls]:
    files = Tls(_text("~ca", ""), _text("~certificate", ""), _text("~key", ""))
    if any(files) and not all(files):
        raise ParameterError("parameters ~ca, ~certificate and ~key belong together")
    return files if all(files) else None
