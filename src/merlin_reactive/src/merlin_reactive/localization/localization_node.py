# SPDX-License-Identifier: Apache-2.0
"""The node ``localization``: a particle filter behind the topics of amcl."""

import math
import threading
from collections import deque
from typing import Deque, Optional

import numpy as np
import rospy
import rospy.rostime
import tf2_ros
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse
from tf2_msgs.msg import TFMessage

from merlin_reactive.localization.particle_filter import FilterSettings, Localizer, ParticleFilter
from merlin_reactive.occupancy_grid import OccupancyGrid as Grid
from merlin_reactive.pose import Pose
from merlin_reactive.robot_state import HISTORY, jumped, odometry_at, rays_of, unusable, unusable_odometry
from merlin_reactive.ros_messages import (
    bad_rotation,
    grid_of,
    pose_message,
    pose_of,
    pose_of_transform,
    transform,
)
from merlin_ros.health import ERROR, OK, WARN, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import graph_name, number

SILENCE = 3.0  # s of ROS time without a scan after which something is wrong
UNSURE = 0.5  # m of standard deviation of the position from which it does not know where it is
SURE_OF_NOTHING = 100.0  # m², rad²: more than any variance of an initial pose
START_SPREAD = (0.15, 0.10)  # m, rad: how well the start pose of a robot is known


class LocalizationNode:
    """Localises one robot.

    :raises ParameterError: a parameter cannot be used.
    """

    def __init__(self) -> None:
        self._settings = FilterSettings(
            particles=round(number("~particles", FilterSettings.particles, 50)),
            beams=round(number("~beams", FilterSettings.beams, 10)),
        )
        self._seed = round(number("~seed", 1, 0))
        self._frame = str(rospy.get_param("~global_frame", "map")).lstrip("/")
        self._lock = threading.Lock()  # guards everything below
        self._localizer: Optional[Localizer] = None
        self._odometry: Deque[Odometry] = deque(maxlen=HISTORY)
        self._mount: Optional[TransformStamped] = None  # of the laser on the robot
        self._scanned: Optional[rospy.Time] = None  # of the last scan
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer)
        self._tf = rospy.Publisher("/tf", TFMessage, queue_size=10)
        self._pose = rospy.Publisher("amcl_pose", PoseWithCovarianceStamped, latch=True, queue_size=10)
        self._cloud = rospy.Publisher("particlecloud", PoseArray, queue_size=2)
        self._service = rospy.Service("global_localization", Empty, self._scatter)
        self._map_topic = graph_name("~map_topic", "/map")
        self._subscribers = [
            rospy.Subscriber(self._map_topic, OccupancyGrid, self._receive_map),
            rospy.Subscriber("initialpose", PoseWithCovarianceStamped, self._receive_pose),
            rospy.Subscriber("odom", Odometry, self._receive_odometry, tcp_nodelay=True, queue_size=20),
            rospy.Subscriber("scan", LaserScan, self._receive_scan, tcp_nodelay=True, queue_size=1),
        ]

    def health(self) -> Health:
        """Whether it knows where the robot is."""
        with self._lock:
            if self._localizer is None:
                return Health(ERROR, f"there is no map on {rospy.resolve_name(self._map_topic)}")
            if not self._odometry:
                return Health(ERROR, f"there is no odometry on {rospy.resolve_name('odom')}")
            silence = (rospy.Time.now() - self._scanned).to_sec() if self._scanned else math.inf
            if abs(silence) > SILENCE:
                return Health(ERROR, f"no scan that can be used on {rospy.resolve_name('scan')}")
            covariance = self._localizer.filter.estimate()[1]
        spread = float(np.sqrt(max(covariance[0, 0], covariance[1, 1])))
        values = {
            "standard deviation of the position, m": f"{spread:.3f}",
            "of the heading, rad": f"{float(np.sqrt(covariance[2, 2])):.3f}",
        }
        if spread > UNSURE:
            return Health(WARN, f"unsure where the robot is, by {spread:.1f} m", values)
        return Health(OK, "knows where the robot is", values)

    def _receive_map(self, message: OccupancyGrid) -> None:
        try:
            grid = grid_of(message)
            if self._has(grid):
                return  # of a map server that was started again: the robot is where it was
            particles = ParticleFilter(grid, self._settings, self._seed, rospy.get_namespace())
        except ValueError as error:
            rospy.logerr(f"localization: {error}")
            return
        start = rospy.get_param("~initial_pose", rospy.get_param("start_pose", None))
        if start is not None:
            try:
                pose = Pose(float(start["x"]), float(start["y"]), float(start.get("yaw", 0.0)))
                if grid.cell(pose.point) is None or not math.isfinite(pose.yaw):
                    raise ValueError("it lies outside the map")
                particles.believe(pose, *START_SPREAD)
            except (KeyError, TypeError, ValueError, AttributeError) as error:
                rospy.logerr(f"localization: the initial pose {start!r} needs x, y and yaw: {error}")
        with self._lock:
            self._localizer = Localizer(particles, self._settings)

    def _has(self, grid: Grid) -> bool:
        """Whether it works on this map, and not on that of a simulator that began anew, as did its robot."""
        with self._lock:
            last = self._odometry[-1].header.stamp if self._odometry else rospy.Time()
            began_anew = not rospy.rostime.is_wallclock() and rospy.Time.now() < last
            return self._localizer is not None and self._localizer.filter.grid.same(grid) and not began_anew

    def _receive_pose(self, message: PoseWithCovarianceStamped) -> None:
        with self._lock:
            localizer = self._localizer
        frame, pose = message.header.frame_id, message.pose.pose
        point, rotation = (pose.position.x, pose.position.y), bad_rotation(pose.orientation)
        reason = ""
        if frame.lstrip("/") not in ("", self._frame):
            reason = f"it is in {frame}, and has to be in {self._frame}"
        elif rotation:
            reason = f"its rotation {rotation}"
        elif localizer is None:
            reason = "there is no map yet"
        elif localizer.filter.grid.cell(point) is None:
            reason = f"{point} lies outside the map"
        if reason or localizer is None:
            rospy.logwarn(f"localization: an initial pose is ignored: {reason}")
            return
        covariance = np.nan_to_num(message.pose.covariance, nan=0.0, posinf=SURE_OF_NOTHING)
        covariance = np.clip(covariance, 0.0, SURE_OF_NOTHING)
        xy = max(0.05, np.sqrt(max(covariance[0], covariance[7])))
        yaw = max(0.05, np.sqrt(covariance[35]))
        with self._lock:
            localizer = self._localizer or localizer  # a new map may have come
            localizer.filter.believe(pose_of(message.pose.pose), xy, yaw)
            localizer.restart()

    def _scatter(self, _: EmptyRequest) -> EmptyResponse:
        with self._lock:
            if self._localizer is not None:
                self._localizer.filter.scatter()
                self._localizer.restart()
        return EmptyResponse()

    def _receive_odometry(self, message: Odometry) -> None:
        reason = unusable_odometry(message)
        if reason:
            rospy.logwarn_throttle(10.0, f"localization: {reason}")
            return
        with self._lock:
            last = self._odometry[-1] if self._odometry else message
            if message.header.stamp < last.header.stamp:  # the simulator began anew, and so did its robot
                self._odometry.clear()
            elif jumped(last, message):  # the base was restarted: it has not moved
                rospy.logwarn("localization: the odometry jumped; the robot counts as where it was")
                self._odometry.clear()
                if self._localizer is not None:
                    self._localizer.restart()
            self._odometry.append(message)

    def _receive_scan(self, message: LaserScan) -> None:
        reason = unusable(message)
        if reason:
            rospy.logwarn_throttle(10.0, f"localization: {reason}")
            return
        with self._lock:
            if self._localizer is None or not self._odometry:
                return
            last = self._odometry[-1]
            if self._mount is None:
                frames = last.child_frame_id.lstrip("/"), message.header.frame_id.lstrip("/")
                try:
                    self._mount = self._buffer.lookup_transform(*frames, rospy.Time(0))
                except tf2_ros.TransformException as error:
                    rospy.logwarn_throttle(10.0, f"localization: where is the laser? {error}")
                    return
            odometry = odometry_at(list(self._odometry), message.header.stamp.to_sec())
            rays = rays_of(message, self._mount)
            updated = self._localizer.update(odometry, pose_of_transform(self._mount), *rays)
            self._scanned = message.header.stamp
            self._publish(message.header.stamp, last.header.frame_id, odometry, updated)

    def _publish(self, stamp: rospy.Time, odom_frame: str, odometry: Pose, updated: bool) -> None:
        assert self._localizer is not None
        offset = self._localizer.map_to_odom
        self._tf.publish(TFMessage(transforms=[transform(offset, self._frame, odom_frame, stamp)]))
        if not updated:
            return
        message = PoseWithCovarianceStamped()
        message.header.frame_id, message.header.stamp = self._frame, stamp
        message.pose.pose = pose_message(offset.compose(odometry))
        covariance = self._localizer.filter.estimate()[1]
        full = np.zeros((6, 6))
        full[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
        message.pose.covariance = full.ravel().tolist()
        self._pose.publish(message)
        if self._cloud.get_num_connections():
            cloud = PoseArray(poses=[pose_message(Pose(*pose)) for pose in self._localizer.filter.poses])
            cloud.header = message.header
            self._cloud.publish(cloud)


def main() -> int:
    """The executable ``localization``; returns its exit code."""
    return run_node(
        "localization", lambda: HealthReporter({"localization": LocalizationNode().health}).start()
    )
