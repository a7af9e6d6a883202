#!/usr/bin/env python3
"""Two robots on one master do their own tasks, know their own things, and share only the world."""

import math
import unittest

import rospy
import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from nav_msgs.msg import Odometry
from smach_msgs.msg import SmachContainerStructure

LONG = 150.0
GOALS = {"r1": "main_door", "r2": "bathroom"}


class Knowledge(MerlinROSPlanAssistant):
    def __init__(self, robot):
        self.knowledge_base = f"/{robot}/rosplan_knowledge_base"


class TwoRobots(unittest.TestCase):
    def test_each_carries_out_its_own_goal(self):
        clients = {
            robot: MerlinExecutorClient(f"/{robot}/merlin/execute", f"/{robot}/rosplan_knowledge_base")
            for robot in GOALS
        }
        for robot, client in clients.items():
            self.assertTrue(client.wait_for_executor(LONG), robot)
        requests = {robot: client.send(f"(checked {GOALS[robot]})") for robot, client in clients.items()}
        for robot, request in requests.items():
            self.assertTrue(request.wait(LONG), robot)
            self.assertEqual(outcome_name(request.result.outcome), "SUCCEEDED", request.result.reason)
        points = rospy.get_param("/r1/world/points_of_interest")
        for robot, poi in GOALS.items():
            self.assertEqual(Knowledge(robot).facts("checked"), [f"(checked {poi})"])
            self.assertEqual(Knowledge(robot).facts("robot_at"), [f"(robot_at {poi})"])
            place = rospy.wait_for_message(f"/{robot}/ground_truth", Odometry).pose.pose.position
            distance = math.hypot(place.x - points[poi]["x"], place.y - points[poi]["y"])
            self.assertLess(distance, 0.3, f"{robot} is not at {poi}")

    def test_viewers_can_tell_their_machines_apart(self):
        paths = {
            rospy.wait_for_message(f"/{robot}/executor/smach/container_structure", SmachContainerStructure).path
            for robot in GOALS
        }
        self.assertEqual(paths, {"/r1_EXECUTOR", "/r2_EXECUTOR"})


if __name__ == "__main__":
    rospy.init_node("two_robots_test")
    rostest.rosrun("merlin_test", "two_robots", TwoRobots)
