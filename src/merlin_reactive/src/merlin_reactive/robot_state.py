# SPDX-License-Identifier: Apache-2.0
"""What navigation knows about its robot, from odom, scan and tf, with a wait for news."""

import math
import threading
from collections import deque
from dataclasses import dataclass
from typing import Deque, Optional, Sequence, Tuple

import numpy as np
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan

from merlin_reactive.pose import Pose, wrap
from merlin_reactive.ros_messages import hangs, pose_of, pose_of_transform
from merlin_ros.deadline import Deadline
from merlin_ros.work.passed_time import PassedTime

HISTORY = 40  # odometry messages kept, to place a scan where it was made
JUMP, JUMP_SPEED = 0.3, 2.0  # m and m/s; no base of this kind moves further between two odometries
JUMP_TURN, JUMP_TURN_SPEED = 0.5, 4.0  # rad and rad/s
AHEAD = 1.0  # s that a stamp may be ahead of the odometry's: localisation dates its transforms ahead


class StateError(Exception):
    """Something about the robot is not known; the text says what and why."""


@dataclass(frozen=True)
class PlacedScan:
    """A scan: angles (rad) and ranges (m), infinite where nothing was hit.

    :ivar pose: of the laser, in the global frame.
    :ivar mount: of the laser on the robot.
    """

    pose: Pose
    angles: np.ndarray
    ranges: np.ndarray
    stamp: float
    mount: Pose


class RobotState:
    """Listens to one robot.

    :param global_frame: frame that poses are wanted in.
    """

    def __init__(self, global_frame: str) -> None:
        self.global_frame = global_frame
        self.changed = threading.Condition()  # guards the messages; notified at each odometry
        self._odometry: Deque[Odometry] = deque(maxlen=HISTORY)
        self._time = PassedTime(0.0)
        self._heard = rospy.Time()  # when the last of it came that had another stamp than before
        self._scan: Optional[LaserScan] = None
        self._mount: Optional[TransformStamped] = None  # of the laser on the robot
        self.buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self.buffer)
        self._subscribers = [
            rospy.Subscriber("odom", Odometry, self._receive_odometry, tcp_nodelay=True, queue_size=20),
            rospy.Subscriber("scan", LaserScan, self._receive_scan, tcp_nodelay=True, queue_size=1),
        ]

    @property
    def time(self) -> float:
        """s that have passed by the stamps of the odometry; never less than before, also when they go back.

        What a drive remembers, and how long it waits, is of this clock.
        """
        with self.changed:
            return self._time.line

    def wait_news(
        self, after: Optional[rospy.Time], stop: threading.Event, timeout: float
    ) -> Optional[Odometry]:
        """Waits for odometry newer than `after`.

        :param timeout: s of running time.
        :return: None when `stop` was set or the time was up first.
        """
        deadline = Deadline(timeout)

        def news() -> bool:
            if stop.is_set():
                return True
            # Not "later": time may jump back when the simulation is reset.
            return bool(self._odometry) and self._odometry[-1].header.stamp != after

        with self.changed:
            found = deadline.wait(self.changed, news)
            return self._odometry[-1] if found and not stop.is_set() else None

    def missing(self, age: float) -> str:
        """What is missing or too old to drive by, as part of a sentence; empty when all is there.

        The odometry has to have come in time. The age of the scan, and of the transform of the odometry's
        frame, is what the odometry is newer: a stall of this process, or another machine's clock, is not one.

        :param age: s of ROS time; a static transform has none.
        """
        with self.changed:
            odometry = self._odometry[-1] if self._odometry else None
            scan, heard = self._scan, self._heard
        if odometry is None:
            return f"nothing has come on {rospy.resolve_name('odom')}"
        silence = (rospy.Time.now() - heard).to_sec()
        if abs(silence) > age:  # negative: the clock was set back
            return f"{rospy.resolve_name('odom')} is silent for {abs(silence):.1f} s"
        if scan is None:
            return f"nothing has come on {rospy.resolve_name('scan')}"
        try:
            frame = self._frame(odometry.header.frame_id)
        except StateError as error:
            return str(error)
        now = odometry.header.stamp
        what = f"the transform from {odometry.header.frame_id} to {self.global_frame}"
        old_scan = _why_old(rospy.resolve_name("scan"), now, scan.header.stamp, age)
        static = frame.header.stamp.is_zero()
        return old_scan or _why_old(what, now, now if static else frame.header.stamp, age)

    def wake(self) -> None:
        """Wakes a wait, so that it re-checks its stop event."""
        with self.changed:
            self.changed.notify_all()

    def pose(self, odometry: Odometry) -> Pose:
        """The pose of the base in the global frame at an odometry message.

        :raises StateError: when localisation says nothing.
        """
        return pose_of_transform(self._frame(odometry.header.frame_id)).compose(pose_of(odometry.pose.pose))

    def scan(self, after: float) -> Optional[PlacedScan]:
        """The newest scan if it was made after a time, s.

        :raises StateError: when it cannot be placed.
        """
        with self.changed:
            message, history = self._scan, list(self._odometry)
        if message is None or not history:
            return None
        stamp = message.header.stamp.to_sec()
        if stamp == after:
            return None
        if self._mount is None:
            frames = history[-1].child_frame_id, message.header.frame_id
            self._mount = self._transform(*frames, "robot_state_publisher")
        mount = pose_of_transform(self._mount)
        odom = pose_of_transform(self._frame(history[-1].header.frame_id))
        base = odom.compose(odometry_at(history, stamp))
        return PlacedScan(base.compose(mount), *rays_of(message, self._mount), stamp, mount)

    def _frame(self, frame: str) -> TransformStamped:
        return self._transform(self.global_frame, frame, "localisation")

    def _transform(self, to: str, frame: str, publisher: str) -> TransformStamped:
        try:
            return self.buffer.lookup_transform(to.lstrip("/"), frame.lstrip("/"), rospy.Time(0))
        except tf2_ros.TransformException as error:
            raise StateError(f"no transform from {frame} to {to}; does {publisher} run? ({error})") from error

    def _receive_odometry(self, message: Odometry) -> None:
        reason = unusable_odometry(message)
        if reason:
            rospy.logwarn_throttle(10.0, f"navigation: {reason}")
            return
        with self.changed:
            if self._odometry and message.header.stamp < self._odometry[-1].header.stamp:
                self._odometry.clear()
            if not self._odometry or message.header.stamp != self._odometry[-1].header.stamp:
                self._heard = rospy.Time.now()
            self._time.look(message.header.stamp.to_sec())
            self._odometry.append(message)
            self.changed.notify_all()

    def _receive_scan(self, message: LaserScan) -> None:
        reason = unusable(message)
        if reason:
            rospy.logwarn_throttle(10.0, f"navigation: {reason}")
            return
        with self.changed:
            self._scan = message


def unusable(message: LaserScan) -> str:
    """Why a scan cannot be used, as a sentence; empty when it can."""
    first, step, count = message.angle_min, message.angle_increment, len(message.ranges)
    least, most = message.range_min, message.range_max
    if count > 1 and math.isfinite(first) and math.isfinite(step) and step != 0.0 and least < most:
        return ""
    return (
        f"a scan is ignored: it has {count} ranges, from {first:g} rad in steps of {step:g} rad, "
        f"from {least:g} m to {most:g} m"
    )


def unusable_odometry(message: Odometry) -> str:
    """Why odometry cannot be used, as a sentence; empty when it can."""
    pose = pose_of(message.pose.pose)
    speed, turn = velocity_of(message)
    if not all(map(math.isfinite, (pose.x, pose.y, pose.yaw))):
        return f"odometry is ignored: its pose ({pose.x:g}, {pose.y:g}, {pose.yaw:g}) is not finite"
    if not (math.isfinite(speed) and math.isfinite(turn)):
        return f"odometry is ignored: its velocity ({speed:g}, {turn:g}) is not finite"
    return ""


def jumped(last: Odometry, odometry: Odometry) -> bool:
    """Whether the wheels cannot have made the way between two odometries."""
    before, after = pose_of(last.pose.pose), pose_of(odometry.pose.pose)
    # A clock that was set back does not say how much has passed.
    elapsed = max(0.0, (odometry.header.stamp - last.header.stamp).to_sec())
    way, turned = before.distance(after), abs(wrap(after.yaw - before.yaw))
    return way > JUMP + JUMP_SPEED * elapsed or turned > JUMP_TURN + JUMP_TURN_SPEED * elapsed


def rays_of(message: LaserScan, mount: TransformStamped) -> Tuple[np.ndarray, np.ndarray]:
    """The rays of a usable scan, counterclockwise as seen from above the robot.

    :param mount: of the laser on the robot.
    :return: angles (rad, ascending) and ranges (m), infinite where nothing was hit.
    """
    ranges = np.array(message.ranges, dtype=float)
    ranges[~((ranges >= message.range_min) & (ranges <= message.range_max))] = math.inf
    angles = message.angle_min + message.angle_increment * np.arange(len(ranges))
    if hangs(mount):
        angles = -angles
    return (angles, ranges) if angles[0] < angles[-1] else (angles[::-1], ranges[::-1])


def velocity_of(message: Odometry) -> Tuple[float, float]:
    """Speed (m/s) and turning speed (rad/s)."""
    return message.twist.twist.linear.x, message.twist.twist.angular.z


def odometry_at(history: Sequence[Odometry], stamp: float) -> Pose:
    """The odometry pose at a time (s), between the messages around it."""
    before = history[0]
    for message in history:
        if message.header.stamp.to_sec() >= stamp:
            first, second = pose_of(before.pose.pose), pose_of(message.pose.pose)
            begin, end = before.header.stamp.to_sec(), message.header.stamp.to_sec()
            part = (stamp - begin) / (end - begin) if end > begin and stamp > begin else 1.0
            return Pose(
                first.x + part * (second.x - first.x),
                first.y + part * (second.y - first.y),
                first.yaw + part * wrap(second.yaw - first.yaw),
            )
        before = message
    return pose_of(before.pose.pose)


def _why_old(what: str, now: rospy.Time, stamp: rospy.Time, age: float) -> str:
    """Why something with a stamp is not of now; empty when it is."""
    old = (now - stamp).to_sec()
    if old < -AHEAD:
        return f"{what} is {-old:.1f} s ahead of the odometry; do their clocks agree?"
    return f"{what} is {old:.1f} s old" if old > age else ""
