#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Two robots in two namespaces on one master: one is cancelled, the other goes on."""

import math
import threading
import unittest

import rospy
from actionlib_msgs.msg import GoalStatusArray
from nav_msgs.msg import Odometry
from rosplan_knowledge_msgs.msg import DomainFormula
from smach_msgs.msg import SmachContainerStructure

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_experiment.mission.ground_truth import receive_one
from merlin_planning.knowledge_client import fact, knowledge_client
from merlin_test import LONG
from merlin_test.topic_links import init_node

ROBOTS = ("r1", "r2")


class TwoRobots(unittest.TestCase):
    def setUp(self):
        self.ways = dict.fromkeys(ROBOTS, 0.0)
        self.positions = {}
        self.moved = {robot: threading.Event() for robot in ROBOTS}
        self.clients = {}
        for robot in ROBOTS:
            knowledge_base = f"{robot}/rosplan_knowledge_base"
            self.assertTrue(knowledge_client(knowledge_base).wait(LONG))
            self.clients[robot] = MerlinExecutorClient(f"{robot}/merlin/execute", knowledge_base)
            self.assertTrue(self.clients[robot].wait_for_executor(LONG))
            for topic in ("move_base", "sound_play", "actions/navigate", "actions/ask"):
                self.assertIsNotNone(receive_one(f"{robot}/{topic}/status", GoalStatusArray, LONG), topic)
            announced = receive_one(f"{knowledge_base}/pddl_action_parameters", DomainFormula, LONG)
            self.assertIsNotNone(announced)
            rospy.Subscriber(f"{robot}/ground_truth", Odometry, self.follow, robot)

    def follow(self, message, robot):
        here = message.pose.pose.position
        before = self.positions.get(robot)
        self.positions[robot] = here
        if before is not None:
            self.ways[robot] += math.hypot(here.x - before.x, here.y - before.y)
        if self.ways[robot] > 0.3:
            self.moved[robot].set()

    def test_a_cancel_reaches_one_robot_only(self):
        requests = {
            "r1": self.clients["r1"].send("(checked main_door)"),
            "r2": self.clients["r2"].send("(checked dorm_room)"),
        }
        for robot in ROBOTS:
            self.assertTrue(self.moved[robot].wait(LONG), f"{robot} did not set off")
        requests["r1"].cancel()
        self.assertTrue(requests["r1"].wait(LONG))
        self.assertEqual(outcome_name(requests["r1"].result.outcome), "CANCELLED")
        self.assertTrue(requests["r2"].wait(LONG))
        result = requests["r2"].result
        self.assertEqual(outcome_name(result.outcome), "SUCCEEDED", result.reason)
        knowledge = {robot: knowledge_client(f"{robot}/rosplan_knowledge_base") for robot in ROBOTS}
        asked = [fact("robot_at", "anywhere"), fact("checked", "main_door"), fact("checked", "dorm_room")]
        self.assertEqual(knowledge["r1"].query(asked), [True, False, False])
        self.assertEqual(knowledge["r2"].query(asked), [False, False, True])

    def test_viewers_can_tell_their_machines_apart(self):
        structures = [
            receive_one(f"/{robot}/executor/smach/container_structure", SmachContainerStructure, LONG)
            for robot in ROBOTS
        ]
        self.assertEqual([structure.path for structure in structures], ["/r1_EXECUTOR", "/r2_EXECUTOR"])


if __name__ == "__main__":
    init_node("two_robots_test")
    rostest.rosrun("merlin_test", "two_robots", TwoRobots)
