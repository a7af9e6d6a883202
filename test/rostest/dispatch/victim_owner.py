#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Has a dispatcher carry out its plan, until it is killed: victim_owner.py DISPATCHER [--plain]."""

import sys

import rospy
from rosplan_dispatch_msgs.srv import DispatchService

from merlin_planning.dispatch_client import DispatchClient
from merlin_test.topic_links import patient_service

rospy.init_node("victim_owner", anonymous=True)
words = rospy.myargv(sys.argv)[1:]
if "--plain" in words:
    print("begins", flush=True)
    patient_service(f"{words[0]}/dispatch_plan", DispatchService)()
else:
    client = DispatchClient(words[0])
    client.wait_status(60.0)
    print("begins", flush=True)
    client.dispatch(lambda interrupt: None)
