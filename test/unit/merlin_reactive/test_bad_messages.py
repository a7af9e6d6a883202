# SPDX-License-Identifier: Apache-2.0
"""Messages that cannot be used are separated from usable ones."""

import math
from typing import Sequence

import numpy as np
import pytest
import rosgraph.masterapi
import rospy
import tf2_ros
from fakes.topics import Topics
from geometry_msgs.msg import Point32, PoseWithCovarianceStamped, Quaternion, TransformStamped
from merlin_msgs.msg import RobotWay
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan

from merlin_reactive.localization import localization_node
from merlin_reactive.navigation.navigation_node import _refuse_jump
from merlin_reactive.navigation.right_of_way import ANNOUNCED, RightOfWay
from merlin_reactive.navigation.way_exchange import WayExchange
from merlin_reactive.pose import Pose
from merlin_reactive.recognition.camera_placement import CameraPlacement
from merlin_reactive.robot_state import StateError, rays_of, unusable, unusable_odometry
from merlin_reactive.ros_messages import grid_of, pose_message, transform


@pytest.mark.parametrize("resolution", [0.0, -0.05, math.nan, math.inf])
def test_a_map_needs_cells_of_a_width(resolution: float) -> None:
    message = OccupancyGrid(data=[0, 0, 100, -1])
    message.info.width = message.info.height = 2
    message.info.resolution = 0.05
    assert grid_of(message).cells.shape == (2, 2)
    message.info.resolution = resolution
    with pytest.raises(ValueError, match="m wide"):
        grid_of(message)


@pytest.mark.parametrize("turn", [Quaternion(0, 0, 1, 0), Quaternion(0, 0, 0.6, 0.8), Quaternion(w=math.nan)])
def test_a_map_that_is_turned_is_refused(turn: Quaternion) -> None:
    message = OccupancyGrid(data=[0, 0, 100, -1])
    message.info.width, message.info.height, message.info.resolution = 2, 2, 0.05
    message.info.origin.orientation = turn
    with pytest.raises(ValueError, match="rotated"):
        grid_of(message)


def test_a_map_lies_somewhere() -> None:
    message = OccupancyGrid(data=[0, 0, 100, -1])
    message.info.width, message.info.height, message.info.resolution = 2, 2, 0.05
    message.info.origin.position.y = math.nan
    with pytest.raises(ValueError, match="origin"):
        grid_of(message)


@pytest.mark.parametrize(
    ("ranges", "angle_min", "increment"),
    [([], 0.0, 0.1), ([1.0], 0.0, 0.1), ([1.0, 2.0], 0.0, 0.0), ([1.0, 2.0], math.nan, 0.1)],
)
def test_a_scan_needs_rays(ranges: list, angle_min: float, increment: float) -> None:
    message = LaserScan(ranges=ranges, angle_min=angle_min, angle_increment=increment, range_max=10.0)
    assert f"it has {len(ranges)} ranges" in unusable(message)


@pytest.mark.parametrize(
    ("least", "most"), [(0.0, 0.0), (0.1, math.nan), (math.nan, 10.0), (5.0, 0.5), (0.0, -1.0)]
)
def test_a_scan_needs_a_range(least: float, most: float) -> None:
    """Else all that it hits counts as nothing, and the robot drives blindly."""
    message = LaserScan(ranges=[1.0, 2.0], angle_increment=0.1, range_min=least, range_max=most)
    assert f"from {least:g} m to {most:g} m" in unusable(message)


def test_a_laser_that_sweeps_clockwise_sees_the_same() -> None:
    sweep = LaserScan(ranges=[1.0, 2.0, math.nan, 30.0], angle_min=-1.0, angle_increment=0.5, range_max=10.0)
    back = LaserScan(
        ranges=sweep.ranges[::-1], angle_min=0.5, angle_increment=-0.5, range_min=0.0, range_max=10.0
    )
    for scan in (sweep, back):
        assert unusable(scan) == ""
        angles, ranges = rays_of(scan, TransformStamped())
        assert angles.tolist() == [-1.0, -0.5, 0.0, 0.5]
        assert ranges.tolist() == [1.0, 2.0, math.inf, math.inf]


def odometry(pose: Pose, at: float) -> Odometry:
    message = Odometry()
    message.header.stamp = rospy.Time.from_sec(at)
    message.pose.pose = pose_message(pose)
    return message


@pytest.mark.parametrize(
    ("after", "jumps"),
    [
        (Pose(1.02, 1.0, 3.1), False),
        (Pose(1.0, 1.0, -3.1), False),  # a hair further round
        (Pose(1.6, 1.0, 3.0), True),
        (Pose(1.0, 1.0, 0.0), True),  # where it began, but turned back
    ],
)
@pytest.mark.parametrize("at", [5.05, 0.0], ids=["", "the clock was set back"])
def test_odometry_that_wheels_cannot_make_is_a_jump(after: Pose, jumps: bool, at: float) -> None:
    before = odometry(Pose(1.0, 1.0, 3.0), 5.0)
    if jumps:
        with pytest.raises(StateError, match="jumped"):
            _refuse_jump(before, odometry(after, at))
    else:
        _refuse_jump(before, odometry(after, at))


@pytest.mark.parametrize("field", ["linear.x", "angular.z"])
def test_a_speed_that_is_no_number_is_not_one_of_a_robot_that_stands(field: str) -> None:
    message = odometry(Pose(1.0, 1.0), 5.0)
    assert not unusable_odometry(message)
    vector, axis = field.split(".")
    setattr(getattr(message.twist.twist, vector), axis, math.nan)
    assert "velocity" in unusable_odometry(message)


@pytest.fixture(params=["map", "/map"])
def topics(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Topics:
    """Those of a localisation that has its map; the laser is on the robot's middle."""
    made = Topics(monkeypatch)
    monkeypatch.setattr(rospy, "Service", lambda *_: None)
    frame = {"~global_frame": request.param}
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: frame.get(name, default))
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(100))
    buffer = tf2_ros.Buffer(debug=False)
    buffer.set_transform_static(transform(Pose(0.0, 0.0), "base", "laser", rospy.Time()), "test")
    monkeypatch.setattr(tf2_ros, "Buffer", lambda: buffer)
    monkeypatch.setattr(tf2_ros, "TransformListener", lambda _: None)
    localization_node.LocalizationNode()
    made.send("/map", room())
    return made


def room() -> OccupancyGrid:
    """A map with walls around it."""
    cells = np.zeros((40, 40), int)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    made = OccupancyGrid(data=cells.ravel().tolist())
    made.info.width, made.info.height, made.info.resolution = 40, 40, 0.1
    return made


def drive(
    topics: Topics, places: Sequence[float], slash: str = "", wall: float = 1.5, begin: float = 100.0
) -> None:
    """The robot is at these places, m, one after the other, and scans there.

    :param slash: with which its frames begin.
    :param wall: how far what it sees is, m.
    :param begin: s of ROS time.
    """
    for step, x in enumerate(places):
        here = odometry(Pose(x, 0.0, 0.0), begin + step)
        here.child_frame_id = f"{slash}base"
        topics.send("/odom", here)
        scan = LaserScan(ranges=[wall] * 40, angle_increment=0.15, range_max=10.0)
        scan.header.stamp, scan.header.frame_id = here.header.stamp, f"{slash}laser"
        topics.send("/scan", scan)


def test_odometry_that_is_no_number_leaves_the_robot_where_it_is_believed_to_be(topics: Topics) -> None:
    drive(topics, (0.0, 0.1, math.nan, 0.2, 0.3))
    believed = list(topics.published("/amcl_pose").queue)
    assert len(believed) == 4
    assert all(math.isfinite(message.pose.pose.position.x) for message in believed)


@pytest.mark.parametrize(("begin", "x"), [(101.1, 2.2), (100.9, 1.1)], ids=["base", "simulator"])
def test_a_base_that_counts_from_zero_again_has_not_moved_but_a_simulated_one_has(
    topics: Topics, begin: float, x: float
) -> None:
    """A simulator that begins anew puts its robot where it began, and its clock begins, too."""
    start = PoseWithCovarianceStamped()
    start.header.frame_id = "map"
    start.pose.pose = pose_message(Pose(2.0, 2.0))
    topics.send("/initialpose", start)
    drive(topics, (1.0, 1.1), wall=math.inf)
    drive(topics, (0.0, 0.1), wall=math.inf, begin=begin)
    believed = topics.published("/amcl_pose").queue[-1].pose.pose.position
    assert (believed.x, believed.y) == pytest.approx((x, 2.0), abs=0.3)


@pytest.mark.parametrize(
    ("cell", "wall", "x"),
    [(0, True, 2.2), (100, True, 0.5), (0, False, 0.5)],
    ids=["the same", "another", "of a simulator that began anew"],
)
def test_a_map_that_comes_again_leaves_the_robot_where_it_is(
    topics: Topics, monkeypatch: pytest.MonkeyPatch, cell: int, wall: bool, x: float
) -> None:
    """As of a map server that was started again, or behind a link that was cut."""
    start = {"~initial_pose": {"x": 0.5, "y": 2.0}}
    believed = PoseWithCovarianceStamped()
    believed.pose.pose = pose_message(Pose(2.0, 2.0))
    topics.send("/initialpose", believed)
    drive(topics, (0.0, 0.1, 0.2), wall=math.inf)
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: start.get(name, default))
    again = room()
    again.info.map_load_time = rospy.Time(99)
    again.data[50] = cell
    monkeypatch.setattr(rospy.rostime, "is_wallclock", lambda: wall)
    topics.send("/map", again)
    drive(topics, (0.21, 0.3), wall=math.inf, begin=110.0)
    position = topics.published("/amcl_pose").queue[-1].pose.pose.position
    assert position.x == pytest.approx(x, abs=0.3)


def test_a_robot_is_localised_by_frames_with_a_slash(topics: Topics) -> None:
    drive(topics, (0.0,), "/")
    assert topics.published("/amcl_pose").qsize() == 1


def test_a_camera_is_placed_by_a_frame_with_a_slash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rosgraph.masterapi.Master, "lookupService", lambda *_: "")
    monkeypatch.setattr(tf2_ros, "TransformListener", lambda _: None)
    placement = CameraPlacement("map")
    placement.set_transform(transform(Pose(2.0, 1.0), "map", "camera", rospy.Time(5)), "test")
    assert placement.at("/camera", rospy.Time(5), lambda: False)[:2, 3].tolist() == [2.0, 1.0]


def test_of_a_way_without_end_its_beginning_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    topics = Topics(monkeypatch)
    rules = RightOfWay("bob", 0.25)
    WayExchange("/ways", "map", rules, lambda: 0.0)
    way = RobotWay(robot="ann", radius=0.25, pose=pose_message(Pose(0.0, 0.0)), driving=True)
    way.header.frame_id = "map"
    way.way = [Point32(0.1 * step, 0.0, 0.0) for step in range(10 * ANNOUNCED)]
    topics.send("/ways", way)
    (ann,) = rules.others(0.0)
    assert len(ann.way) == ANNOUNCED
