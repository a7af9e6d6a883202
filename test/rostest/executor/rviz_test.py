# SPDX-License-Identifier: Apache-2.0
"""What rviz shows and sends: markers, and clicked places that become goals at the Executor."""

import threading
import time
import unittest

import rosnode
import rospy
from geometry_msgs.msg import PoseStamped
from merlin_msgs.msg import ExecuteActionGoal, ExecuteActionResult
from rosgraph_msgs.msg import Log
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from merlin_executor.core.outcome import outcome_name
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.topic_links import patient_service, publishers_of, wait_for_publishers

NODE = "rviz_markers"


def wait(holds):
    """Waits for what ROS has no event for."""
    end = time.monotonic() + LONG
    while not holds():
        assert time.monotonic() < end and not rospy.is_shutdown()
        rospy.rostime.wallsleep(0.05)


class Heard:
    """All messages of a topic."""

    def __init__(self, topic, kind):
        self.changed = threading.Condition()
        self.messages = []
        self.subscriber = rospy.Subscriber(topic, kind, self.receive, tcp_nodelay=True, queue_size=1000)

    def receive(self, message):
        with self.changed:
            self.messages.append(message)
            self.changed.notify_all()

    def wait(self, holds):
        """The first message of which this holds."""
        with self.changed:
            found = self.changed.wait_for(lambda: [each for each in self.messages if holds(each)], LONG)
            assert found, f"{self.subscriber.name}: nothing of that in {len(self.messages)} messages"
            return found[0]

    def of_rviz(self):
        """The goals of the node, which its clicked places have become."""
        with self.changed:
            return [goal for goal in self.messages if goal._connection_header["callerid"].endswith(NODE)]


class Rviz(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        assert MerlinExecutorClient().wait_for_executor(LONG)
        cls.knowledge = MerlinROSPlanAssistant()
        cls.points = rospy.get_param("world/points_of_interest")
        cls.clicks = rospy.Publisher("merlin/clicked_goal", PoseStamped, queue_size=10)
        cls.log = Heard("/rosout", Log)
        cls.goals = Heard("merlin/execute/goal", ExecuteActionGoal)
        cls.results = Heard("merlin/execute/result", ExecuteActionResult)
        wait(lambda: "/" + NODE in rosnode.get_node_names())
        for heard in (cls.log, cls.goals):
            wait(lambda heard=heard: "/" + NODE in publishers_of(heard.subscriber))
        wait_for_publishers(cls.results.subscriber)
        wait(cls.clicks.get_num_connections)

    def click(self, x, y, frame="map"):
        place = PoseStamped()
        place.header.frame_id = frame
        place.pose.position.x, place.pose.position.y, place.pose.orientation.w = x, y, 1.0
        self.clicks.publish(place)

    def click_near(self, name):
        self.click(self.points[name]["x"] + 0.3, self.points[name]["y"] - 0.2)

    def elsewhere(self, count):
        """Points at which the robot is not."""
        here = str(self.knowledge.facts("robot_at"))
        return [name for name in self.points if name not in here][:count]

    def ended(self, goal):
        """How the request of a goal has ended."""
        identity = self.goals.wait(lambda sent: sent.goal.goals == [goal]).goal_id.id
        result = self.results.wait(lambda ended: ended.status.goal_id.id == identity).result
        return outcome_name(result.outcome)

    def test_a_new_subscriber_gets_the_points(self):
        names = {name.replace("_", " ") for name in self.points}
        for _ in range(2):  # a late subscriber too, when nothing changes any more
            heard = Heard("merlin/markers", MarkerArray)
            heard.wait(lambda shown: {m.text for m in shown.markers if m.ns == "point names"} == names)
            heard.subscriber.unregister()

    def test_a_clicked_place_becomes_a_goal_at_the_executor(self):
        (point,) = self.elsewhere(1)
        self.click_near(point)
        self.assertEqual(self.ended(f"(robot_at {point})"), "SUCCEEDED")
        self.assertEqual(self.elsewhere(4).count(point), 0, "it is there")
        self.log.wait(lambda line: line.msg == f"rviz: (robot_at {point}): SUCCEEDED")

    def test_the_next_click_takes_the_place_of_the_last_one(self):
        first, second = self.elsewhere(2)
        self.assertTrue(patient_service("merlin/pause", Trigger)().success)
        try:
            self.click_near(first)
            self.goals.wait(lambda sent: sent.goal.goals == [f"(robot_at {first})"])
            self.click_near(second)
            self.assertEqual(self.ended(f"(robot_at {first})"), "CANCELLED")
        finally:
            self.assertTrue(patient_service("merlin/resume", Trigger)().success)
        self.assertEqual(self.ended(f"(robot_at {second})"), "SUCCEEDED")

    def test_a_click_that_means_no_point_is_told_and_sends_nothing(self):
        before = len(self.goals.of_rviz())
        self.click(40.0, 2.0)
        told = self.log.wait(lambda line: "no point of interest within 2 m" in line.msg)
        self.assertIn("no goal is sent", told.msg)
        self.assertNotIn("\n", told.msg)
        self.click(1.0, 2.0, frame="odom")
        self.log.wait(lambda line: "frame 'odom'" in line.msg)
        self.assertEqual(len(self.goals.of_rviz()), before)
