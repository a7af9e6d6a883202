# SPDX-License-Identifier: Apache-2.0
"""The ROS side of one simulated robot: commands in; odometry, transforms and sensors out."""

import math
from concurrent.futures import Future
from typing import List, NamedTuple, Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, Twist
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image, JointState, LaserScan

from merlin_reactive.occupancy_grid import OccupancyGrid
from merlin_reactive.pose import Pose
from merlin_reactive.ros_messages import pose_message, transform
from merlin_ros.publishing import publish
from merlin_sim.engine.simulation import ODOMETRY_EVERY, PHYSICS_RATE, Simulation, WorldRobot
from merlin_sim.node.pending_pictures import PendingPictures
from merlin_sim.rendering.shot import PictureError
from merlin_sim.robot.camera import CameraError, CameraModel
from merlin_sim.robot.truth_localization import TruthLocalization, map_to_odom


def grid_message(grid: OccupancyGrid, stamp: rospy.Time) -> GridMessage:
    """A map as a message."""
    message = GridMessage()
    message.header.frame_id, message.header.stamp = "map", stamp
    message.info.map_load_time = stamp
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = grid.cells.shape
    message.info.origin = pose_message(Pose(*grid.origin))
    message.data = grid.cells.ravel().tolist()
    return message


def image_message(picture: np.ndarray, frame: str, stamp: rospy.Time) -> Image:
    """A picture, height x width x 3, RGB, as a message."""
    height, width = picture.shape[:2]
    message = Image(height=height, width=width, encoding="rgb8", step=3 * width)
    message.header.frame_id, message.header.stamp = frame, stamp
    message.data = np.ascontiguousarray(picture).tobytes()
    return message


def camera_info(model: CameraModel, frame: str, stamp: rospy.Time) -> CameraInfo:
    """The geometry of a camera without distortion as a message."""
    matrix = model.matrix()
    message = CameraInfo(height=model.height, width=model.width, distortion_model="plumb_bob", D=[0.0] * 5)
    message.header.frame_id, message.header.stamp = frame, stamp
    message.K = matrix.ravel().tolist()
    message.R = np.eye(3).ravel().tolist()
    message.P = np.hstack([matrix, np.zeros((3, 1))]).ravel().tolist()
    return message


SCAN_PERIOD = 10  # 10 Hz
JOINTS_PERIOD = 20  # 5 Hz, for rviz only
POSE_PERIOD = 50  # 2 Hz, amcl's habit


class Capture(NamedTuple):
    """A picture that is being made.

    :ivar pixels: height x width x 3, RGB, or a PictureError.
    :ivar transforms: that place the camera at that moment, without those broadcast already.
    """

    pixels: "Future[np.ndarray]"
    info: CameraInfo
    transforms: List[TransformStamped]

    def image(self) -> Image:
        """The picture as a message; waits for it.

        :raises PictureError: there is none.
        """
        return image_message(self.pixels.result(), self.info.header.frame_id, self.info.header.stamp)


class RobotInterface:
    """Topics and frames of one robot, below its namespace.

    :param localization: makes map→odom; None when something else does.
    :param pictures: where its pictures are made.
    :param camera_rate: pictures per s of simulated time, while there is a subscriber.
    """

    def __init__(
        self,
        simulation: Simulation,
        robot: WorldRobot,
        localization: Optional[TruthLocalization],
        pictures: PendingPictures,
        camera_rate: float,
    ) -> None:
        self._pictures = pictures
        self.attach(simulation, robot, localization)
        name = robot.spec.name
        topics = f"/{name}" if name else ""
        self._camera_period = max(1, round(PHYSICS_RATE / camera_rate))
        self._prefix = f"{name}/" if name else ""
        self._odom = rospy.Publisher(f"{topics}/odom", Odometry, queue_size=10)
        self._truth = rospy.Publisher(f"{topics}/ground_truth", Odometry, queue_size=10)
        self._scan = rospy.Publisher(f"{topics}/scan", LaserScan, queue_size=10)
        self._joints = rospy.Publisher(f"{topics}/joint_states", JointState, queue_size=10)
        self._amcl = rospy.Publisher(
            f"{topics}/amcl_pose", PoseWithCovarianceStamped, latch=True, queue_size=10
        )
        self._image = rospy.Publisher(f"{topics}/camera/image_raw", Image, queue_size=1)
        self._info = rospy.Publisher(f"{topics}/camera/camera_info", CameraInfo, queue_size=1)
        self._commands = rospy.Subscriber(f"{topics}/cmd_vel", Twist, self._command, tcp_nodelay=True)

    def attach(
        self, simulation: Simulation, robot: WorldRobot, localization: Optional[TruthLocalization]
    ) -> None:
        """Speaks for another body from now on: the world began anew."""
        self._simulation = simulation
        self._robot = robot
        self._localization = localization
        self._placed_at = -1  # tick of the latest transforms

    def _command(self, twist: Twist) -> None:
        self._robot.base.command(twist.linear.x, twist.angular.z, self._simulation.time)

    def publish(self, tick: int, stamp: rospy.Time) -> List[TransformStamped]:
        """Publishes what is due at a physics step; returns the transforms to broadcast."""
        transforms: List[TransformStamped] = []
        if tick % ODOMETRY_EVERY == 0:
            self._publish_odometry(tick, stamp)
            transforms = self._transforms(stamp)
        if tick % SCAN_PERIOD == 0 and self._scan.get_num_connections():
            self._publish_scan(stamp)
        if tick % JOINTS_PERIOD == 0 and self._joints.get_num_connections():
            joints = JointState(
                name=["left_wheel_joint", "right_wheel_joint"],
                position=[angle % (2 * math.pi) for angle in self._robot.body.wheel_angles()],
            )
            joints.header.stamp = stamp
            self._joints.publish(joints)
        if tick % self._camera_period == 0:
            transforms += self._publish_picture(stamp)
        return transforms

    def capture(self, stamp: rospy.Time) -> Capture:
        """Has a picture made of what the camera sees now.

        :raises CameraError: the robot has no camera.
        """
        pixels = self._pictures.take(self._simulation.shot(self._robot), stamp)
        info = camera_info(self._robot.spec.camera, self._prefix + "camera_optical_frame", stamp)
        # Between two beats of odometry, and while time stands still, nothing else says where the robot is.
        transforms = [] if self._placed_at == self._simulation.tick else self._transforms(stamp)
        return Capture(pixels, info, transforms)

    def _publish_picture(self, stamp: rospy.Time) -> List[TransformStamped]:
        """Has it published when it is made, if there is a subscriber; returns the transforms to broadcast."""
        if not self._image.get_num_connections():
            return []
        try:
            capture = self.capture(stamp)
        except CameraError as error:
            rospy.logwarn_once(f"merlin_sim: {error}")
            return []
        capture.pixels.add_done_callback(lambda _: self._publish_image(capture))
        return capture.transforms

    def _publish_image(self, capture: Capture) -> None:
        try:
            image = capture.image()
        except PictureError as error:
            rospy.logwarn(f"no camera image: {error}")
            return
        publish(self._image, image)
        publish(self._info, capture.info)

    def _publish_odometry(self, tick: int, stamp: rospy.Time) -> None:
        odometry = self._robot.odometry
        base_frame = self._prefix + "base_footprint"
        if self._odom.get_num_connections():
            message = _odometry(odometry.pose, *odometry.velocity, self._prefix + "odom", base_frame, stamp)
            self._odom.publish(message)
        truth = self._robot.body.pose()
        if self._localization is not None and tick % POSE_PERIOD == 0:
            pose = PoseWithCovarianceStamped()
            pose.header.frame_id, pose.header.stamp = "map", stamp
            pose.pose.pose = pose_message(self._localization.estimate(truth, self._simulation.time))
            pose.pose.covariance = self._localization.covariance()
            self._amcl.publish(pose)
        if self._truth.get_num_connections():
            self._truth.publish(_odometry(truth, *self._robot.body.velocity(), "map", base_frame, stamp))

    def _transforms(self, stamp: rospy.Time) -> List[TransformStamped]:
        """Where the robot is now, in the simulated world."""
        tick = self._placed_at = self._simulation.tick
        speed, turn = self._robot.odometry.velocity
        late = tick % ODOMETRY_EVERY / PHYSICS_RATE  # s since the encoders were read
        odometry = self._robot.odometry.pose.compose(Pose(speed * late, 0.0, turn * late))
        odom_frame = self._prefix + "odom"
        transforms = [transform(odometry, odom_frame, self._prefix + "base_footprint", stamp)]
        if self._localization is not None:
            believed = self._localization.estimate(self._robot.body.pose(), self._simulation.time)
            transforms.append(transform(map_to_odom(believed, odometry), "map", odom_frame, stamp))
        return transforms

    def _publish_scan(self, stamp: rospy.Time) -> None:
        lidar = self._robot.lidar
        message = LaserScan(
            angle_min=-math.pi,
            angle_max=math.pi - lidar.increment,
            angle_increment=lidar.increment,
            scan_time=SCAN_PERIOD / PHYSICS_RATE,
            range_min=lidar.model.range_min,
            range_max=lidar.model.range_max,
            ranges=self._simulation.scan(self._robot),
        )
        message.header.frame_id, message.header.stamp = self._prefix + "base_laser", stamp
        self._scan.publish(message)


def _odometry(pose: Pose, speed: float, turn: float, frame: str, child: str, stamp: rospy.Time) -> Odometry:
    message = Odometry(child_frame_id=child)
    message.header.frame_id, message.header.stamp = frame, stamp
    message.pose.pose = pose_message(pose)
    message.twist.twist.linear.x, message.twist.twist.angular.z = speed, turn
    return message
