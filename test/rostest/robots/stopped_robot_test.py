#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A robot that was stopped where another one has to go is known to stand there, and is moved away."""

import threading
import unittest

import rospy
from merlin_msgs.msg import KnowledgeChanges, RobotWay
from rosplan_dispatch_msgs.msg import ActionDispatch

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_ros.publishing import OnSubscriber
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.announced_interfaces import wait_for_interfaces
from merlin_test.held_drives import HeldDrives
from merlin_test.topic_links import init_node, wait_for_publishers

ROBOTS = ("robot_1", "robot_2")


class StoppedRobot(unittest.TestCase):
    def setUp(self):
        self.changed = threading.Condition()
        self.dispatched = []
        self.knowledge = MerlinROSPlanAssistant()
        heard = threading.Event()
        notice = OnSubscriber(lambda _: heard.set())
        self.ways = rospy.Publisher("/robot_ways", RobotWay, notice, queue_size=10)
        rospy.Subscriber("rosplan_knowledge_base/changes", KnowledgeChanges, self.wake, tcp_nodelay=True)
        dispatches = rospy.Subscriber(
            "rosplan_plan_dispatcher/action_dispatch", ActionDispatch, self.note, tcp_nodelay=True
        )
        self.drives = HeldDrives("robot_1")
        self.addCleanup(self.drives.end)
        wait_for_interfaces("navigate", "line_up")
        self.client = MerlinExecutorClient()
        self.assertTrue(self.client.wait_for_executor(LONG))
        self.assertTrue(heard.wait(LONG), "the bridges follow the ways")
        wait_for_publishers(dispatches)
        for robot in ROBOTS:
            self.assertTrue(self.until(lambda robot=robot: self.knowledge.holds(f"(available {robot})")))

    def wake(self, _):
        with self.changed:
            self.changed.notify_all()

    def note(self, dispatch):
        if dispatch.name == "cancel_action":
            return
        with self.changed:
            self.dispatched.append(" ".join([dispatch.name, *(entry.value for entry in dispatch.parameters)]))
            self.changed.notify_all()

    def until(self, happens):
        with self.changed:
            return self.changed.wait_for(happens, LONG)

    def done(self, goal, actions):
        """What was dispatched until a goal is reached, so many actions or more."""
        before = len(self.dispatched)
        request = self.client.send(goal)
        self.assertTrue(request.wait(LONG))
        result = request.result
        self.assertEqual(outcome_name(result.outcome), "SUCCEEDED", result.reason)
        self.assertTrue(self.until(lambda: len(self.dispatched) >= before + actions), self.dispatched)
        return self.dispatched[before:]

    def test_it_keeps_the_place_at_which_it_stands_and_makes_room(self):
        way = RobotWay(robot="robot_1", radius=0.2)
        way.pose.position.x, way.pose.position.y = 4.5, 4.5  # 0.4 m from table_4
        self.ways.publish(way)  # the bridges have it long before a plan is made and its drive begun
        self.drives.hold()
        request = self.client.send("(robot_at robot_1 table_5)")
        self.assertTrue(self.until(lambda: "navigate robot_1 anywhere table_5" in self.dispatched))
        self.assertTrue(self.until(lambda: not self.knowledge.holds("(robot_at robot_1 anywhere)")))
        # Cancelled before its state machine begins, the drive has not begun: the robot is where it was.
        self.drives.wait_driving()
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertTrue(self.knowledge.holds("(robot_at robot_1 table_4)"))
        self.assertFalse(self.knowledge.holds("(free table_4)"))
        self.assertFalse(self.knowledge.holds("(in_position robot_1)"))
        self.assertTrue(self.knowledge.holds("(free table_5)"))

        self.assertEqual(self.done("(in_position robot_1)", 1), ["line_up robot_1 table_4"])
        first, second = self.done("(robot_at robot_2 table_4)", 2)
        self.assertTrue(first.startswith("navigate robot_1 table_4 "), first)
        self.assertEqual(second, "navigate robot_2 anywhere table_4")


if __name__ == "__main__":
    init_node("stopped_robot_test")
    rostest.rosrun("merlin_test", "stopped_robot", StoppedRobot)
