# SPDX-License-Identifier: Apache-2.0
"""What a laser that hangs upside down sees on its left is on the robot's right: REP 103, as tf has it."""

import math
from types import SimpleNamespace
from typing import Any, Dict, List, Tuple
from unittest.mock import MagicMock

import pytest
import rospy
import tf2_ros
from geometry_msgs.msg import Quaternion, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan

from merlin_reactive.localization import localization_node
from merlin_reactive.localization.localization_node import LocalizationNode
from merlin_reactive.pose import Pose
from merlin_reactive.robot_state import RobotState
from merlin_reactive.ros_messages import transform

NOW = rospy.Time(100.0)
UPRIGHT = Quaternion(w=1.0)
HANGS = Quaternion(x=1.0)  # turned about the axis that points forward
HANGS_TURNED = Quaternion(x=0.5**0.5, y=0.5**0.5)  # and then to the left, by a quarter
#: 2 m of the laser away on its left, and nothing else.
SCAN = LaserScan(
    ranges=[9.0, 9.0, 9.0, 2.0], angle_min=-math.pi / 2, angle_increment=math.pi / 3, range_max=5.0
)


def mount(rotation: Quaternion) -> TransformStamped:
    """Of a laser 0.2 m before the centre."""
    message = transform(Pose(0.2, 0.0, 0.0), "base", "laser", NOW)
    message.transform.rotation = rotation
    return message


def hit(place: Pose, angles: Any, ranges: Any) -> Tuple[float, float]:
    """Where the only ray that hit something ends."""
    ((angle, distance),) = [ray for ray in zip(angles, ranges) if math.isfinite(ray[1])]
    end = place.compose(Pose(distance * math.cos(angle), distance * math.sin(angle), 0.0))
    return round(end.x, 6), round(end.y, 6)


def free_map() -> OccupancyGrid:
    """Of 5 m by 5 m."""
    message = OccupancyGrid(data=[0] * 10_000)
    message.info.width = message.info.height = 100
    message.info.resolution, message.info.origin.orientation.w = 0.05, 1.0
    return message


@pytest.fixture
def topics(monkeypatch: pytest.MonkeyPatch) -> Dict[str, Any]:
    found: Dict[str, Any] = {}
    monkeypatch.setattr(rospy, "Subscriber", lambda topic, _, call, **__: found.update({topic: call}))
    monkeypatch.setattr(tf2_ros, "TransformListener", lambda _: None)
    buffer = tf2_ros.Buffer(debug=False)
    monkeypatch.setattr(tf2_ros, "Buffer", lambda: buffer)
    buffer.set_transform_static(transform(Pose(0.0, 0.0, 0.0), "map", "odom", NOW), "test")
    found["buffer"] = buffer
    return found


def hear(topics: Dict[str, Any]) -> None:
    """One odometry of a robot that stands at the origin, then the scan."""
    odometry = Odometry(child_frame_id="base")
    odometry.header.frame_id, odometry.header.stamp = "odom", NOW
    odometry.pose.pose.orientation.w = 1.0
    SCAN.header.frame_id, SCAN.header.stamp = "laser", NOW
    topics["odom"](odometry)
    topics["scan"](SCAN)


@pytest.mark.parametrize(
    ("rotation", "place"),
    [(UPRIGHT, (0.2, 2.0)), (HANGS, (0.2, -2.0)), (HANGS_TURNED, (2.2, 0.0))],
)
def test_navigation_sees_an_obstacle_on_its_side(
    topics: Dict[str, Any], rotation: Quaternion, place: Tuple[float, float], clock: Any
) -> None:
    clock.set(NOW.to_sec())
    topics["buffer"].set_transform_static(mount(rotation), "test")
    state = RobotState("map")
    hear(topics)
    scan = state.scan(0.0)
    assert scan is not None
    assert hit(scan.pose, scan.angles, scan.ranges) == place
    assert list(scan.angles) == sorted(scan.angles)


@pytest.mark.parametrize(("rotation", "place"), [(UPRIGHT, (0.2, 2.0)), (HANGS, (0.2, -2.0))])
def test_localization_sees_a_wall_on_its_side(
    topics: Dict[str, Any], monkeypatch: pytest.MonkeyPatch, rotation: Quaternion, place: Tuple[float, float]
) -> None:
    seen: List[Tuple[float, float]] = []

    def update(_: Pose, laser: Pose, angles: Any, ranges: Any) -> bool:
        seen.append(hit(laser, angles, ranges))
        return False

    localizer = SimpleNamespace(update=update, map_to_odom=Pose(0.0, 0.0, 0.0))
    monkeypatch.setattr(localization_node, "Localizer", lambda *_: localizer)
    for name in ("Publisher", "Service"):
        monkeypatch.setattr(rospy, name, MagicMock())
    monkeypatch.setattr(rospy, "get_param", lambda _, default=None: default)
    topics["buffer"].set_transform_static(mount(rotation), "test")
    LocalizationNode()
    topics["/map"](free_map())
    hear(topics)
    assert seen == [place]
