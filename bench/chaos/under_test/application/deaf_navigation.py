# SPDX-License-Identifier: Apache-2.0
"""A move_base that drives in a circle and ignores every cancel. Takes navigation's place and its remaps."""

import sys
import threading

import actionlib
import rospy
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction

SPEED, TURN = 0.2, 0.4  # m/s, rad/s: a circle of half a metre
PERIOD = 0.1  # s of wall time between two commands


class DeafNavigation:
    """Drives while it has a goal; only another goal ends it."""

    def __init__(self) -> None:
        self._goal = None
        self._lock = threading.Lock()  # guards _goal
        self._publisher = rospy.Publisher("cmd_vel", Twist, queue_size=10)
        self._server = actionlib.ActionServer("move_base", MoveBaseAction, self._take, self._ignore, False)
        self._server.start()

    def run(self) -> None:
        """Commands until the node ends."""
        over = threading.Event()
        rospy.on_shutdown(over.set)
        while not over.wait(PERIOD):
            with self._lock:
                driving = self._goal is not None
            if driving:
                command = Twist()
                command.linear.x, command.angular.z = SPEED, TURN
                self._publisher.publish(command)

    def _take(self, goal: actionlib.ServerGoalHandle) -> None:
        with self._lock:
            if self._goal is not None:
                self._goal.set_aborted(text="another goal came")
            goal.set_accepted()
            self._goal = goal

    def _ignore(self, goal: actionlib.ServerGoalHandle) -> None:
        rospy.loginfo("a cancel came, and is ignored")


if __name__ == "__main__":
    rospy.init_node("navigation", argv=sys.argv)
    DeafNavigation().run()
