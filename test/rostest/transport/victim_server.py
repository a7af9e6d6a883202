#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""An action server, which waits for a cancel, and a service: for tests that kill their process."""

import rospy
from rosplan_dispatch_msgs.msg import NonBlockingDispatchAction, NonBlockingDispatchResult
from std_srvs.srv import Trigger, TriggerResponse

from merlin_ros.actions.serial_action_server import SerialActionServer


def execute(goal):
    goal.cancel_event.wait()
    goal.cancelled(NonBlockingDispatchResult(success=True), "stopped on request")


rospy.init_node("victim")
server = SerialActionServer("victim/wait", NonBlockingDispatchAction, execute)
server.start()
rospy.Service("victim/ask", Trigger, lambda request: TriggerResponse(True, rospy.get_name()))
rospy.spin()
