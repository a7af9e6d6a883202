"""The ROS side of one simulated robot: commands in; odometry, transforms and sensors out."""

import math
from typing import List, Optional

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState, LaserScan

from merlin_sim.localization import TruthLocalization, map_to_odom
from merlin_sim.prompt_publisher import PromptPublisher
from merlin_sim.ros_messages import pose_message, transform
from merlin_sim.simulation import PHYSICS_RATE, SimulatedRobot, Simulation
from merlin_sim.world import Pose

ODOMETRY_PERIOD = 5  # physics steps: 20 Hz
SCAN_PERIOD = 10  # 10 Hz
JOINTS_PERIOD = 20  # 5 Hz, for rviz only
POSE_PERIOD = 50  # 2 Hz, amcl's habit


class RobotInterface:
    """Topics and frames of one robot, below its namespace.

    :param localization: makes map→odom; None when something else does.
    """

    def __init__(
        self,
        simulation: Simulation,
        robot: SimulatedRobot,
        localization: Optional[TruthLocalization],
    ) -> None:
        self.attach(simulation, robot, localization)
        name = robot.spec.name
        topics = f"/{name}" if name else ""
        self._prefix = f"{name}/" if name else ""
        self._odom = PromptPublisher(f"{topics}/odom", Odometry)
        self._truth = PromptPublisher(f"{topics}/ground_truth", Odometry)
        self._scan = PromptPublisher(f"{topics}/scan", LaserScan)
        self._joints = PromptPublisher(f"{topics}/joint_states", JointState)
        self._amcl = PromptPublisher(f"{topics}/amcl_pose", PoseWithCovarianceStamped, latch=True)
        self._commands = rospy.Subscriber(f"{topics}/cmd_vel", Twist, self._command, tcp_nodelay=True)

    def attach(
        self, simulation: Simulation, robot: SimulatedRobot, localization: Optional[TruthLocalization]
    ) -> None:
        """Speaks for another body from now on: the world began anew."""
        self._simulation = simulation
        self._robot = robot
        self._localization = localization

    def _command(self, twist: Twist) -> None:
        self._robot.base.command(twist.linear.x, twist.angular.z, self._simulation.time)

    def publish(self, tick: int, stamp: rospy.Time) -> List[TransformStamped]:
        """Publishes what is due at a physics step; returns the transforms to broadcast."""
        transforms: List[TransformStamped] = []
        if tick % ODOMETRY_PERIOD == 0:
            transforms = self._publish_odometry(tick, stamp)
        if tick % SCAN_PERIOD == 0 and self._scan.wanted:
            self._publish_scan(stamp)
        if tick % JOINTS_PERIOD == 0 and self._joints.wanted:
            joints = JointState(
                name=["left_wheel_joint", "right_wheel_joint"],
                position=[angle % (2 * math.pi) for angle in self._robot.body.wheel_angles()],
            )
            joints.header.stamp = stamp
            self._joints.publish(joints)
        return transforms

    def _publish_odometry(self, tick: int, stamp: rospy.Time) -> List[TransformStamped]:
        odometry = self._robot.odometry
        odom_frame, base_frame = self._prefix + "odom", self._prefix + "base_footprint"
        if self._odom.wanted:
            self._odom.publish(_odometry(odometry.pose, *odometry.velocity, odom_frame, base_frame, stamp))
        transforms = [transform(odometry.pose, odom_frame, base_frame, stamp)]
        truth = self._robot.body.pose()
        if self._localization is not None:
            believed = self._localization.estimate(truth, self._simulation.time)
            transforms.append(transform(map_to_odom(believed, odometry.pose), "map", odom_frame, stamp))
            if tick % POSE_PERIOD == 0:
                message = PoseWithCovarianceStamped()
                message.header.frame_id, message.header.stamp = "map", stamp
                message.pose.pose = pose_message(believed)
                message.pose.covariance = self._localization.covariance()
                self._amcl.publish(message)
        if self._truth.wanted:
            self._truth.publish(_odometry(truth, *self._robot.body.velocity(), "map", base_frame, stamp))
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
