#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A move_base on the original actionlib: it commands a velocity while a goal runs, and may ignore cancels.

`move_base/stubborn` (std_srvs/SetBool): whether it does. `move_base/end` (std_srvs/Empty): ends its goals.
"""

import actionlib
import rospy
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction
from std_srvs.srv import Empty, EmptyResponse, SetBool, SetBoolResponse


class StubbornBase:
    def __init__(self):
        self.stubborn = False
        self.running = {}
        self.commands = rospy.Publisher("cmd_vel", Twist, queue_size=10)
        # Its lock guards the fields above, too: it is held when a cancel comes, and taken to end a goal.
        self.server = actionlib.ActionServer("move_base", MoveBaseAction, self.begin, self.cancel, False)
        self.server.start()
        rospy.Service("move_base/end", Empty, self.end)
        rospy.Service("move_base/stubborn", SetBool, self.set_stubborn)

    def set_stubborn(self, request):
        with self.server.lock:
            self.stubborn = request.data
        return SetBoolResponse(success=True)

    def begin(self, goal):
        with self.server.lock:
            goal.set_accepted()
            self.running[goal.get_goal_id().id] = goal

    def cancel(self, goal):
        with self.server.lock:
            if not self.stubborn and self.running.pop(goal.get_goal_id().id, None) is not None:
                self.commands.publish(Twist())
                goal.set_canceled()

    def end(self, _):
        with self.server.lock:
            for goal in self.running.values():
                goal.set_succeeded()
            self.running.clear()
        return EmptyResponse()

    def run(self):
        forward = Twist()
        forward.linear.x = 0.3
        while not rospy.is_shutdown():
            with self.server.lock:
                if self.running:
                    self.commands.publish(forward)
            rospy.rostime.wallsleep(0.05)


rospy.init_node("base")
StubbornBase().run()
