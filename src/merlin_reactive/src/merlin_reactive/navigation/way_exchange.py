# SPDX-License-Identifier: Apache-2.0
"""Publishes where this robot drives, and receives where others do."""

from typing import Callable, Optional

import numpy as np
import rospy
from geometry_msgs.msg import Point32
from merlin_msgs.msg import RobotWay as WayMessage

from merlin_reactive.navigation.right_of_way import ANNOUNCED, RightOfWay, RobotWay
from merlin_reactive.ros_messages import pose_message, pose_of
from merlin_ros.publishing import publish

ROS_PERIOD = 0.1  # s of ROS time between two words of a robot that drives


class WayExchange:
    """Speaks on a topic that all robots share, while this one drives.

    :param topic: global name.
    :param frame: of all poses; a way in another frame is ignored.
    :param now: s, by the clock with which the rules are asked.
    """

    def __init__(self, topic: str, frame: str, rules: RightOfWay, now: Callable[[], float]) -> None:
        self._rules, self._frame, self._now = rules, frame, now
        self._last: Optional[WayMessage] = None  # of the drive that continues
        self._publisher = rospy.Publisher(topic, WayMessage, queue_size=10)
        self._subscriber = rospy.Subscriber(topic, WayMessage, self._hear, tcp_nodelay=True, queue_size=20)

    def publish(self, said: Optional[RobotWay], stamp: rospy.Time) -> None:
        """Publishes the way, at most once per period."""
        if said is None:
            return
        if self._last and 0.0 <= (stamp - self._last.header.stamp).to_sec() < ROS_PERIOD:
            return
        message = WayMessage(
            robot=said.name,
            radius=said.radius,
            pose=pose_message(said.pose),
            way=[Point32(x, y, 0.0) for x, y in said.way],
            cornered=said.cornered,
            aside=said.aside,
            driving=said.driving,
        )
        message.header.frame_id, message.header.stamp = self._frame, stamp
        self._last = message
        publish(self._publisher, message)

    def end(self) -> None:
        """The drive has ended: to the others this robot is an obstacle like any other."""
        last, self._last = self._last, None
        if last is not None:
            last.driving = False
            publish(self._publisher, last)

    def _hear(self, message: WayMessage) -> None:
        way = np.array([(point.x, point.y) for point in message.way[:ANNOUNCED]]).reshape(-1, 2)
        numbers = [message.radius, message.pose.position.x, message.pose.position.y]
        reason = ""
        if not (np.isfinite(way).all() and np.isfinite(numbers).all() and message.radius > 0.0 and len(way)):
            reason = "says of its way what is not finite"
        elif message.header.frame_id.lstrip("/") != self._frame:
            reason = f"speaks in {message.header.frame_id}, not {self._frame}"
        if reason:
            rospy.logwarn_throttle(10.0, f"navigation: robot {message.robot} {reason}")
            return
        other = RobotWay(
            message.robot,
            pose_of(message.pose),
            message.radius,
            way,
            message.cornered,
            message.aside,
            message.driving,
        )
        self._rules.note(other, self._now())
