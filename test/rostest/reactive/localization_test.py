#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The particle filter in place: it drives by its own belief, and finds back from a wrong one."""

import math
import threading
import unittest

import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry

import rostest
from merlin_ros.actions.action_client import ActionClient
from merlin_test import LONG
from merlin_test.topic_links import init_node, wait_for_connections


class Localization(unittest.TestCase):
    def setUp(self):
        self.changed = threading.Condition()
        self.truth = self.belief = None
        self.health = {}
        self.subscribers = [
            rospy.Subscriber("ground_truth", Odometry, self.receive, "truth", tcp_nodelay=True),
            rospy.Subscriber("amcl_pose", PoseWithCovarianceStamped, self.receive, "belief"),
        ]
        self.client = ActionClient("move_base", MoveBaseAction)
        self.assertTrue(self.client.wait_for_server(LONG))
        # A drive waits for 10 s for a simulator and a filter that begin together with this test.
        self.wait(lambda: self.truth is not None and self.belief is not None)

    def receive(self, message, name):
        with self.changed:
            setattr(self, name, message)
            self.changed.notify_all()

    def diagnose(self, message):
        with self.changed:
            self.health.update({status.name: status.message for status in message.status})
            self.changed.notify_all()

    def wait(self, predicate):
        with self.changed:
            self.assertTrue(self.changed.wait_for(predicate, timeout=LONG), f"error {self.error()}")

    def error(self):
        if self.truth is None or self.belief is None:
            return math.inf
        one, two = self.truth.pose.pose.position, self.belief.pose.pose.position
        return math.hypot(one.x - two.x, one.y - two.y)

    def away_from(self, x, y):
        where = self.truth.pose.pose.position
        return math.hypot(where.x - x, where.y - y)

    def drive(self, x, y):
        goal = MoveBaseGoal()
        goal.target_pose.header.frame_id = "map"
        goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = x, y
        goal.target_pose.pose.orientation.w = 1.0
        # Not leased: a busy machine may let a client stand still for longer than its lease lasts.
        return self.client.send(goal, lasting=True)

    def refuse_nonsense(self, publisher):
        for x, w in ((math.nan, 1.0), (1e308, 1.0), (4.0, 0.0), (4.0, math.nan)):
            nonsense = PoseWithCovarianceStamped()
            nonsense.header.frame_id = "map"
            nonsense.pose.pose.position.x, nonsense.pose.pose.orientation.w = x, w
            nonsense.pose.covariance[0] = math.nan
            publisher.publish(nonsense)

    def test_it_tells_that_it_knows_where_the_robot_is(self):
        self.subscribers.append(rospy.Subscriber("/diagnostics", DiagnosticArray, self.diagnose))
        self.wait(lambda: self.health.get("localization: localization") == "knows where the robot is")

    def test_it_drives_by_its_belief_and_finds_back(self):
        goal = self.drive(4.8, 3.5)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED, goal.text)
        self.wait(lambda: self.error() < 0.25 and self.away_from(4.8, 3.5) < 0.25)

        publisher = rospy.Publisher("initialpose", PoseWithCovarianceStamped, queue_size=1)
        wait_for_connections(publisher)
        wrong = PoseWithCovarianceStamped()
        wrong.header.frame_id = "map"
        wrong.pose.pose.position.x, wrong.pose.pose.position.y = 4.3, 3.2
        wrong.pose.pose.orientation.w = 1.0
        self.refuse_nonsense(publisher)
        wrong.pose.covariance[0] = wrong.pose.covariance[7] = wrong.pose.covariance[35] = 0.25
        publisher.publish(wrong)
        goal = self.drive(2.6, 3.4)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED, goal.text)
        self.wait(lambda: self.error() < 0.3)


if __name__ == "__main__":
    init_node("localization_test")
    rostest.rosrun("merlin_test", "localization", Localization)
