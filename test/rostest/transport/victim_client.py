#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""An action client that sends one goal to the action ``owned`` and wants it until it is killed; or none."""

import sys

import rospy
from rosplan_dispatch_msgs.msg import NonBlockingDispatchAction, NonBlockingDispatchGoal

from merlin_ros.actions.action_client import ActionClient

rospy.init_node("victim_client")
client = ActionClient("owned", NonBlockingDispatchAction)
client.wait_for_server()
if "--idle" not in sys.argv:
    client.send(NonBlockingDispatchGoal())
rospy.spin()
