#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A client of move_base that leases its goal: for tests that kill, hang and restart it.

Reads commands from its input, one a line, and answers each with a line: `drive`, `drive suspended`,
`suspend`, `resume`, `release`.
"""

import sys
import threading
import time
import uuid

import rospy
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import Lease
from move_base_msgs.msg import MoveBaseActionGoal

from merlin_test import LONG

rospy.init_node("motion_client", disable_signals=True)
goals = rospy.Publisher("move_base/goal", MoveBaseActionGoal, queue_size=1)
leases = rospy.Publisher("move_base/lease", Lease, queue_size=1)
life = uuid.uuid4().hex
changed = threading.Condition()
held, suspended = [], []


def beat():
    with changed:
        while True:
            if held:
                leases.publish(Lease(owner=rospy.get_name(), life=life, held=held, suspended=suspended))
            changed.wait(0.15)


def reaches(publisher, *nodes):
    return {link.endpoint_id for link in publisher.impl.connections}.issuperset(nodes)


threading.Thread(target=beat, daemon=True).start()
for line in sys.stdin:
    answer = line.strip()
    with changed:
        if answer in ("drive", "drive suspended"):
            end = time.monotonic() + LONG
            while not (reaches(goals, "/base", "/merlin_guard") and reaches(leases, "/merlin_guard")):
                changed.wait(0.02)
                assert time.monotonic() < end, "neither base nor guard has connected"
            held[:] = [f"goal-{uuid.uuid4().hex}"]
            suspended[:] = held if answer == "drive suspended" else []
            (answer,) = held
            leases.publish(Lease(owner=rospy.get_name(), life=life, held=held, suspended=suspended))
            goals.publish(MoveBaseActionGoal(goal_id=GoalID(rospy.Time.now(), answer)))
        elif answer == "suspend":
            suspended[:] = held
        elif answer == "resume":
            suspended.clear()
        elif answer == "release":
            held.clear()
            leases.publish(Lease(owner=rospy.get_name(), life=life))
        changed.notify_all()
    print(answer, flush=True)
