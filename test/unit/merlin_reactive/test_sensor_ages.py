# SPDX-License-Identifier: Apache-2.0
"""Navigation stands while odometry, scan or transforms are too old, says which, and drives on after that."""

import math
import queue
import threading
from types import SimpleNamespace
from typing import Any, Dict, Iterator, List

import pytest
import rospy
import tf2_ros
from geometry_msgs.msg import Point32, PoseStamped, TransformStamped, Twist
from merlin_msgs.msg import RobotWay
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan

from merlin_reactive import robot_state
from merlin_reactive.navigation import navigation_node, velocity_publisher, way_exchange
from merlin_reactive.navigation.navigation_node import SENSOR_AGE, NavigationNode
from merlin_reactive.pose import Pose
from merlin_reactive.ros_messages import pose_message, transform
from merlin_test import LONG

STEP = 0.05  # s of ROS time between two messages
SENSORS = ("odom", "scan", "tf")


class Goal:
    """A goal of the action server, and what is said of it."""

    def __init__(self) -> None:
        target = PoseStamped()
        target.header.frame_id = "map"
        target.pose.position.x, target.pose.position.y, target.pose.orientation.w = 4.0, 2.5, 1.0
        self.goal = SimpleNamespace(target_pose=target)
        self.cancel_event = threading.Event()
        self.reported: List[str] = []
        self.text = ""

    @property
    def cancel_requested(self) -> bool:
        return self.cancel_event.is_set()

    def tell(self, text: str) -> None:
        self.reported.append(text)

    def abort(self, text: str) -> None:
        self.text = text

    def feedback(self, _: Any) -> None:
        """Nobody listens."""

    cancelled = succeed = abort


class Robot:
    """The topics of a robot at (1, 2.5), which stands whatever it is told, and its navigation."""

    def __init__(self, clock: Any, monkeypatch: pytest.MonkeyPatch, **parameters: Any) -> None:
        self.receive: Dict[str, Any] = {}
        self.velocities: queue.Queue[Twist] = queue.Queue()
        self.buffer: Any = None
        self._clock, self._time = clock, 100.0
        self.x = 1.0  # m, of its odometry
        self.sees = 9.0  # m, all round; more than 5: nothing
        self.slash = ""  # before each frame in its messages
        self.stamps: Dict[str, float] = {}  # s, of sensors whose messages say another time than now
        self.ahead = 0.0  # s, the clock of the base
        for module in (navigation_node, robot_state, velocity_publisher):
            monkeypatch.setattr(module.rospy, "Subscriber", self._subscribe)
            monkeypatch.setattr(module.rospy, "Publisher", self._advertise)
        monkeypatch.setattr(rospy, "Service", lambda *_: None)
        monkeypatch.setattr(rospy, "on_shutdown", lambda _: None)
        monkeypatch.setattr(rospy, "get_param", lambda name, default=None: parameters.get(name[1:], default))
        for level in ("loginfo", "logwarn", "logerr"):
            monkeypatch.setattr(rospy, level, lambda *_: None)
        made = tf2_ros.Buffer(debug=False)
        monkeypatch.setattr(robot_state.tf2_ros, "Buffer", lambda: made)
        monkeypatch.setattr(robot_state.tf2_ros, "TransformListener", lambda _: None)
        monkeypatch.setattr(navigation_node, "SerialActionServer", self._serve)
        monkeypatch.setattr(velocity_publisher, "publish", lambda publisher, twist: publisher.publish(twist))
        NavigationNode()
        self.buffer = made
        self.set_clock(self._time)
        world = OccupancyGrid(data=[0] * 10_000)
        world.info.width = world.info.height = 100
        world.info.resolution, world.info.origin.orientation.w = 0.05, 1.0
        self.receive["map"](world)

    def _subscribe(self, topic: str, _: Any, callback: Any, **__: Any) -> None:
        self.receive[topic.strip("/")] = callback

    def _advertise(self, topic: str, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(publish=self.velocities.put if topic == "cmd_vel" else lambda _: None)

    def _serve(self, name: str, _: Any, execute: Any, cancel: Any) -> Any:
        self.execute, self.cancel = execute, cancel
        return SimpleNamespace(name=name, start=lambda: None)

    @staticmethod
    def _transform(parent: str, child: str, at: float) -> TransformStamped:
        return transform(Pose(0.0, 0.0, 0.0), parent, child, rospy.Time.from_sec(at))

    def set_clock(self, time: float) -> None:
        """ROS time is another, s, and tf begins anew, as its listener does then."""
        self._time = time
        self.buffer.clear()
        self.buffer.set_transform_static(self._transform("base", "laser", 0.0), "test")

    def tick(self, *silent: str) -> None:
        """Time passes, and all sensors but the silent ones speak."""
        self._time += STEP
        self._clock.set(self._time)
        if "tf" not in silent:
            self.buffer.set_transform(self._transform("map", "odom", self._time + self.ahead), "test")
        if "scan" not in silent:
            scan = LaserScan(ranges=[self.sees] * 9, angle_min=-3.2, angle_increment=0.8, range_max=5.0)
            scan.header.stamp, scan.header.frame_id = self._stamp("scan"), f"{self.slash}laser"
            self.receive["scan"](scan)
        if "odom" not in silent:
            odometry = Odometry(child_frame_id=f"{self.slash}base")
            odometry.header.stamp, odometry.header.frame_id = self._stamp("odom"), f"{self.slash}odom"
            odometry.pose.pose.position.x, odometry.pose.pose.position.y = self.x, 2.5
            odometry.pose.pose.orientation.w = 1.0
            self.receive["odom"](odometry)

    def _stamp(self, sensor: str) -> rospy.Time:
        return rospy.Time.from_sec(self.stamps.get(sensor, self._time + self.ahead))

    def speed(self) -> float:
        """Of the next command."""
        return float(self.velocities.get(timeout=LONG).linear.x)

    def drives(self) -> None:
        """All sensors speak until it drives."""
        for _ in range(3):  # what belongs to messages of before may still come
            self.tick()
            self.speed()
        self.tick()
        assert self.speed() > 0.0

    def stands(self, *silent: str) -> None:
        """Sensors are silent for longer than they may be, until navigation has the base stand."""
        for _ in range(round(SENSOR_AGE / STEP) + 2):
            self.tick(*silent)
        for _ in range(100):
            if self.speed() == 0.0:
                return
            self.tick(*silent)
        pytest.fail(f"it drives on without {silent}")


@pytest.fixture
def goal() -> Goal:
    return Goal()


@pytest.fixture
def robot(clock: Any, monkeypatch: pytest.MonkeyPatch, goal: Goal) -> Iterator[Robot]:
    made = Robot(clock, monkeypatch)
    driving = threading.Thread(target=made.execute, args=(goal,), daemon=True)
    made.driving = driving  # type: ignore[attr-defined]
    driving.start()
    yield made
    goal.cancel_event.set()
    made.cancel(goal)
    driving.join(LONG)
    assert not driving.is_alive()


@pytest.mark.parametrize("sensor", SENSORS)
def test_it_stands_without_a_sensor_and_drives_on_with_it(robot: Robot, goal: Goal, sensor: str) -> None:
    robot.drives()
    robot.stands(sensor)
    what = {"tf": "the transform from odom to map", "scan": "/scan", "odom": "/odom"}[sensor]
    robot.tick(sensor)
    assert goal.reported and what in goal.reported[-1]
    while goal.reported[-1]:
        robot.tick()
        robot.speed()
    robot.drives()


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_goal_fails_when_the_sensor_does_not_come_back(
    robot: Robot, goal: Goal, sensor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.drives()
    monkeypatch.setattr(navigation_node, "PATIENCE", 0.0)
    robot.drives()
    for _ in range(round(SENSOR_AGE / STEP) + 2):
        robot.tick(sensor)
    robot.driving.join(LONG)  # type: ignore[attr-defined]
    assert goal.text.startswith(navigation_node.NO_CONTROL_TEXT) and sensor in goal.text.replace(
        "transform", "tf"
    )


def test_a_static_transform_never_is_too_old(robot: Robot) -> None:
    robot.drives()
    robot.buffer.clear()
    robot.buffer.set_transform_static(robot._transform("base", "laser", 0.0), "test")
    robot.buffer.set_transform_static(robot._transform("map", "odom", 0.0), "test")
    for _ in range(20):
        robot.tick("tf")
        assert robot.speed() >= 0.0
    robot.tick("tf")
    assert robot.speed() > 0.0


def test_odometry_that_is_no_number_is_none(robot: Robot, goal: Goal) -> None:
    robot.drives()
    robot.x = math.nan
    robot.stands()
    robot.tick()
    assert "/odom" in goal.reported[-1]
    robot.x = 1.0
    while goal.reported[-1]:
        robot.tick()
        robot.speed()
    robot.drives()


@pytest.mark.parametrize("stamp", [0.0, 100.1])
@pytest.mark.parametrize("sensor", ["scan", "odom"])
def test_what_has_always_the_same_stamp_gets_old(robot: Robot, goal: Goal, sensor: str, stamp: float) -> None:
    robot.drives()
    robot.stamps[sensor] = stamp
    robot.stands()
    robot.tick()
    assert f"/{sensor}" in goal.reported[-1]


def test_frames_of_tf_with_their_slash_are_the_same(robot: Robot) -> None:
    robot.slash = "/"
    robot.drives()


@pytest.mark.parametrize("ahead", [-30.0, 0.0, 30.0])
def test_it_gives_way_whatever_the_clock_of_its_base_says(
    clock: Any, monkeypatch: pytest.MonkeyPatch, goal: Goal, ahead: float
) -> None:
    monkeypatch.setattr(way_exchange, "publish", lambda publisher, way: publisher.publish(way))
    bob = Robot(clock, monkeypatch, robot="bob", robot_ways="/ways")
    bob.ahead = ahead
    ann = RobotWay(robot="ann", radius=0.25, pose=pose_message(Pose(1.65, 1.5)), driving=True)
    ann.header.frame_id = "map"
    ann.way = [Point32(1.65, 1.5 + 0.1 * step, 0.0) for step in range(20)]
    driving = threading.Thread(target=bob.execute, args=(goal,), daemon=True)
    driving.start()
    try:
        bob.drives()
        for _ in range(5):  # a command of before may still come
            bob.receive["ways"](ann)
            bob.tick()
            speed = bob.speed()
        assert speed == 0.0
    finally:
        goal.cancel_event.set()
        bob.cancel(goal)
        driving.join(LONG)


def test_a_clock_that_is_set_back_makes_its_patience_no_longer(
    clock: Any, monkeypatch: pytest.MonkeyPatch, goal: Goal
) -> None:
    robot = Robot(clock, monkeypatch, patience=1.0)
    driving = threading.Thread(target=robot.execute, args=(goal,), daemon=True)
    driving.start()
    try:
        robot.drives()
        robot.sees = 0.4
        for _ in range(5):
            robot.tick()
            robot.speed()
        robot.set_clock(20.0)
        for _ in range(400):  # 20 s; it backs off for 10 s once
            robot.tick()
            robot.speed()
            if goal.text:
                break
        assert goal.text.startswith(navigation_node.NO_PLAN_TEXT)
    finally:
        goal.cancel_event.set()
        robot.cancel(goal)
        driving.join(LONG)
