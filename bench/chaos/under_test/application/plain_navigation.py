# SPDX-License-Identifier: Apache-2.0
"""A move_base of plain actionlib that drives open loop: it knows no lease. Takes navigation's place.

It drives in a small circle until it is preempted, so that what is known of the robot's place stays true.
"""

import sys

import actionlib
import rospy
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

SPEED, TURN = 0.2, 0.4  # m/s, rad/s: a circle of half a metre
RATE = 10.0  # Hz


class PlainNavigation:
    """A SimpleActionServer, as its tutorial has it."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("cmd_vel", Twist, queue_size=10)
        self._server = actionlib.SimpleActionServer("move_base", MoveBaseAction, self._drive, False)
        self._server.start()

    def _drive(self, _: MoveBaseGoal) -> None:
        command, rate = Twist(), rospy.Rate(RATE)
        command.linear.x, command.angular.z = SPEED, TURN
        while not self._server.is_preempt_requested() and not rospy.is_shutdown():
            self._publisher.publish(command)
            rate.sleep()
        self._publisher.publish(Twist())
        self._server.set_preempted(text="preempted")


if __name__ == "__main__":
    rospy.init_node("navigation", argv=sys.argv)
    PlainNavigation()
    rospy.spin()
