#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""move_base as its clients see it: goals, answers, cancels, plans."""

import math
import threading
import unittest
from pathlib import Path

import rospy
import yaml
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, Twist
from merlin_msgs.srv import SetRealTimeFactor
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry
from nav_msgs.srv import GetPlan
from std_srvs.srv import Empty, Trigger

import rostest
from merlin_ros.actions.action_client import ActionClient
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.topic_links import init_node, patient_service, wait_for_connections


def pose(x, y, yaw=0.0, frame="map"):
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = x, y
    message.pose.orientation.z, message.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return message


class Navigation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.changed = threading.Condition()
        cls.truth = None
        cls.commands = []  # speeds, in order
        cls.client = ActionClient("move_base", MoveBaseAction)
        cls.subscribers = [
            rospy.Subscriber("ground_truth", Odometry, cls.receive_truth, tcp_nodelay=True),
            rospy.Subscriber("cmd_vel", Twist, cls.receive_command, tcp_nodelay=True, queue_size=100),
        ]
        assert cls.client.wait_for_server(LONG)
        with cls.changed:  # a drive waits for 10 s for a simulator that begins together with this test
            assert cls.changed.wait_for(lambda: cls.truth is not None, LONG), "the simulator has started"

    @classmethod
    def receive_truth(cls, message):
        with cls.changed:
            cls.truth = message
            cls.changed.notify_all()

    @classmethod
    def receive_command(cls, message):
        with cls.changed:
            cls.commands.append((message.linear.x, message.angular.z))
            cls.changed.notify_all()

    def wait(self, predicate):
        with self.changed:
            self.assertTrue(self.changed.wait_for(predicate, timeout=LONG), "did not come true")

    def send(self, target):
        # Not leased: a busy machine may let a client stand still for longer than its lease lasts.
        return self.client.send(MoveBaseGoal(target_pose=target), lasting=True)

    def refused(self, target, *words):
        goal = self.send(target)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.ABORTED)
        for word in words:
            self.assertIn(word, goal.text)

    def driving(self):
        return self.truth is not None and abs(self.truth.twist.twist.linear.x) > 0.2

    def is_at(self, x, y, yaw):
        where = self.truth.pose.pose
        turned = 2 * math.atan2(where.orientation.z, where.orientation.w)
        return (
            math.hypot(where.position.x - x, where.position.y - y) < 0.2
            and abs(math.remainder(turned - yaw, 2 * math.pi)) < 0.2
        )

    def test_it_drives_to_a_point_of_interest(self):
        point = rospy.get_param("world/points_of_interest/dorm_room")
        goal = self.send(pose(point["x"], point["y"], point["yaw"]))
        self.assertTrue(goal.wait(LONG))
        self.assertEqual((goal.status, goal.text), (GoalStatus.SUCCEEDED, "Goal reached."))
        # What travels on other topics may come behind the result.
        self.wait(lambda: goal.feedback is not None)
        self.assertEqual(goal.feedback.base_position.header.frame_id, "map")
        self.wait(lambda: self.is_at(point["x"], point["y"], point["yaw"]))
        self.wait(lambda: self.commands[-1] == (0.0, 0.0))

    def pace(self, factor):
        change = patient_service("/merlin_sim/set_real_time_factor", SetRealTimeFactor)
        self.assertTrue(change(factor).success)

    def drive_slowly(self, x, y):
        """A drive that lasts longer than a busy machine may stand still, as time passes slowly."""
        self.addCleanup(self.pace, 2.0)
        self.pace(0.5)
        return self.send(pose(x, y))

    def test_a_cancel_stops_the_robot_for_good(self):
        goal = self.drive_slowly(4.8, 3.6)
        self.wait(lambda: self.driving() and self.commands and self.commands[-1][0] > 0.0)
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.PREEMPTED)
        self.wait(lambda: self.commands[-1] == (0.0, 0.0))
        self.wait(lambda: abs(self.truth.twist.twist.linear.x) < 0.01)
        with self.changed:
            stopped, before = self.truth, len(self.commands)
        self.wait(lambda: (self.truth.header.stamp - stopped.header.stamp).to_sec() > 2.0)
        moved = self.truth.pose.pose.position.x - stopped.pose.pose.position.x
        self.assertLess(abs(moved), 0.01)
        self.assertLessEqual(set(self.commands[before:]), {(0.0, 0.0)}, "a command came after the stop")

    def from_start(self):
        start = rospy.get_param("start_pose")
        where = self.truth.pose.pose.position
        return math.hypot(where.x - start["x"], where.y - start["y"])

    def test_a_reset_of_the_world_ends_the_drive_and_the_next_goal_is_driven_to(self):
        goal = self.drive_slowly(4.8, 5.5)
        self.wait(lambda: self.driving() and self.from_start() > 1.0)
        self.assertTrue(patient_service("/merlin_sim/reset", Trigger)().success)
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.ABORTED)
        self.assertIn("The odometry jumped", goal.text)
        self.wait(lambda: self.from_start() < 0.1)
        self.pace(2.0)
        again = self.send(pose(4.8, 3.6))
        self.assertTrue(again.wait(LONG))
        self.assertEqual(again.status, GoalStatus.SUCCEEDED, again.text)

    def test_a_newer_goal_takes_over(self):
        first = self.drive_slowly(4.8, 5.5)
        self.wait(self.driving)
        here = self.truth.pose.pose.position
        second = self.send(pose(here.x, here.y))
        self.assertTrue(first.wait(LONG))
        self.assertEqual(first.status, GoalStatus.PREEMPTED)
        self.assertTrue(second.wait(LONG))
        self.assertEqual(second.status, GoalStatus.SUCCEEDED)

    def test_goals_that_can_never_be_reached_end_at_once(self):
        self.refused(pose(50.0, 3.0), "Failed to find a valid plan", "outside the map")
        self.refused(pose(1e308, -1e308), "Failed to find a valid plan", "outside the map")
        self.refused(pose(3.8, 5.5), "Failed to find a valid plan", "inside an obstacle")
        self.refused(pose(0.2, 3.4), "Failed to find a valid plan", "radius")
        self.refused(pose(4.8, 3.4, frame="moon"), "moon")
        self.refused(pose(4.8, 3.4, frame=""), "no frame")
        self.refused(pose(math.nan, 3.4), "not finite")
        nothing = pose(4.8, 3.4)
        nothing.pose.orientation.z = nothing.pose.orientation.w = 0.0
        self.refused(nothing, "invalid quaternion")
        tilted = pose(4.8, 3.4)
        tilted.pose.orientation.x, tilted.pose.orientation.w = 0.7071, 0.7071
        self.refused(tilted, "invalid quaternion", "vertical")

    def test_goals_in_other_frames(self):
        goal = self.send(pose(0.0, 0.0, frame="r1/base_footprint"))
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED)

    def test_plans_are_made_without_driving(self):
        plan = patient_service("move_base/make_plan", GetPlan)
        self.assertTrue(plan.wait(LONG))
        poses = plan(pose(0.6, 1.05), pose(7.6, 1.2), 0.0).plan.poses
        self.assertAlmostEqual(poses[0].pose.position.x, 0.6, delta=0.1)
        self.assertAlmostEqual(poses[-1].pose.position.x, 7.6, delta=0.1)
        self.assertEqual(plan(pose(0.6, 1.05), pose(3.8, 5.5), 0.0).plan.poses, [])
        near = plan(pose(0.6, 1.05), pose(3.8, 5.5), 0.6).plan.poses[-1].pose.position
        self.assertLess(math.hypot(near.x - 3.8, near.y - 5.5), 0.61)
        far = plan(pose(0.6, 1.05), pose(1e6, 0.0), math.inf).plan.poses[-1].pose.position
        self.assertGreater(far.x, 8.0)
        self.assertEqual(plan(pose(0.6, 1.05), pose(3.8, 5.5), math.nan).plan.poses, [])
        patient_service("move_base/clear_costmaps", Empty)()

    def test_a_plain_pose_is_a_goal_too(self):
        here = self.truth.pose.pose.position
        publisher = rospy.Publisher("move_base_simple/goal", PoseStamped, queue_size=1)
        current = Received("move_base/current_goal", PoseStamped)
        self.addCleanup(current.close)
        wait_for_connections(publisher)
        publisher.publish(pose(here.x, here.y))
        current.wait(lambda goal: (goal.pose.position.x, goal.pose.position.y) == (here.x, here.y))

    def test_what_rviz_shows_is_published(self):
        """The topics of merlin.rviz, which a unit test compares with this list; see also executor.test."""
        listed = yaml.safe_load(Path(__file__).parents[2].joinpath("data", "rviz_topics.yaml").read_text())
        wanted = {(rospy.resolve_name(topic), kind) for topic, kind in listed.items()}
        end = threading.Event()
        for _ in range(int(LONG)):  # the nodes begin together with this test
            missing = wanted - {tuple(pair) for pair in rospy.get_published_topics()}
            if not missing or end.wait(1.0):
                break
        self.assertEqual(missing, set())
        self.assertTrue(rospy.has_param("robot_description"))


if __name__ == "__main__":
    init_node("navigation_test")
    rostest.rosrun("merlin_test", "navigation", Navigation)
