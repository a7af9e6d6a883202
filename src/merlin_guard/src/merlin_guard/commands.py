# SPDX-License-Identifier: Apache-2.0
"""The velocities on their way through the guard: within the limits of the base, and watched."""

from typing import Tuple

import rospy
from geometry_msgs.msg import Twist, Vector3
from nav_msgs.msg import Odometry

from merlin_guard.drive_watch import DriveWatch
from merlin_guard.guard_parameters import GuardParameters
from merlin_guard.motion_permit import MotionPermit, PermitDecision, Send
from merlin_guard.velocity_limits import STANDING, Velocity, VelocityLimiter


class Commands:
    """Passes velocities on, as far as the permit and the limits of the base allow.

    Not thread-safe: its owner calls it with the lock of the permit held.

    :param source: topic on which they come.
    :param permit: whether the base may move.
    :param parameters: of the node.
    """

    def __init__(self, source: str, permit: MotionPermit, parameters: GuardParameters) -> None:
        self._permit = permit
        self._limiter = VelocityLimiter(parameters.limits, parameters.refuse)
        self.watch = DriveWatch(source, parameters.settings)
        self.warning = ""
        """What is wrong with the drive, as of the last :meth:`look`; empty: nothing."""
        self._odometry = rospy.Subscriber(
            "odom", Odometry, self._receive_odometry, tcp_nodelay=True, queue_size=1
        )

    def receive(self, velocity: Twist, now: float) -> Tuple[PermitDecision, Twist]:
        """Takes a velocity.

        :param now: s of the monotonic clock.
        :return: what has to happen, and the velocity for the base.
        """
        linear, angular = velocity.linear, velocity.angular
        asked = Velocity(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
        sent, fault = self._limiter.judge(asked, now)
        decision = self._permit.command(any(sent), now)
        if decision.send is not Send.COMMAND:
            sent, fault = STANDING, ""
        self._limiter.sent(sent, now)
        self.watch.command(sent, fault, self._permit.world)
        if fault:
            velocity = Twist(Vector3(sent.x, sent.y, 0.0), Vector3(0.0, 0.0, sent.yaw))
        return decision, velocity

    def stood(self) -> None:
        """Zero went to the base for another reason."""
        self._limiter.stood()

    def look(self) -> None:
        """Time has passed; to be called several times per second."""
        self.warning = self.watch.look(self._permit.drivers, self._permit.view.goals, self._permit.world)

    def _receive_odometry(self, odometry: Odometry) -> None:
        position, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        self.watch.odometry((position.x, position.y, turn.z, turn.w))
