#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Two robots in one plan, at once, over a planning system that behaves as the original ROSPlan does."""

import threading
import unittest

import rospy
from geometry_msgs.msg import Twist
from std_srvs.srv import SetBool

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.announced_interfaces import wait_for_interfaces
from merlin_test.topic_links import init_node, wait_for_publishers

ROBOTS = ("ann", "bob")


class Drives:
    """Which robots drive now, the first to begin first."""

    def __init__(self):
        self._changed = threading.Condition()  # guards the field below
        self._driving = []
        self._subscribers = [
            rospy.Subscriber(f"{robot}/cmd_vel", Twist, self._moved, robot, tcp_nodelay=True)
            for robot in ROBOTS
        ]
        for subscriber in self._subscribers:
            wait_for_publishers(subscriber)

    def _moved(self, velocity, robot):
        with self._changed:
            if (velocity != Twist()) != (robot in self._driving):
                (self._driving.remove if robot in self._driving else self._driving.append)(robot)
                self._changed.notify_all()

    def wait(self, count):
        """Waits until so many robots drive at once; returns their names."""
        with self._changed:
            assert self._changed.wait_for(lambda: len(self._driving) == count, LONG), self._driving
            return list(self._driving)

    def close(self):
        for subscriber in self._subscribers:
            subscriber.unregister()


class RobotsOverROSPlan(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = MerlinExecutorClient()
        cls.knowledge = MerlinROSPlanAssistant()
        assert cls.client.wait_for_executor(LONG)
        cls.available = {robot: rospy.ServiceProxy(f"{robot}/merlin/available", SetBool) for robot in ROBOTS}
        cls.hold = {robot: rospy.ServiceProxy(f"{robot}/base/hold", SetBool) for robot in ROBOTS}
        for service in (*cls.available.values(), *cls.hold.values()):
            service.wait_for_service(LONG)
        wait_for_interfaces("drive")  # what is sent before it listens is latched, and never carried out

    def setUp(self):
        for robot in ROBOTS:
            self.hold[robot](True)  # its next drive lasts until it is cancelled, or let go
            self.available[robot](True)
            self.until_available(robot)
        self.knowledge.remove_facts(self.knowledge.facts("visited"))
        self.drives = Drives()
        self.addCleanup(self.drives.close)

    def let_go(self, *robots):
        for robot in robots:
            self.hold[robot](False)

    def until_available(self, robot):
        end = rospy.get_time() + LONG
        while not self.knowledge.holds(f"(available {robot})"):  # this knowledge base tells of no change
            self.assertLess(rospy.get_time(), end, robot)
            rospy.sleep(0.05)

    def position(self, robot):
        facts = [fact for fact in self.knowledge.facts("robot_at") if f" {robot} " in fact]
        self.assertEqual(len(facts), 1, facts)
        return facts[0].strip("()").split()[2]

    def assertOutcome(self, result, name):
        self.assertEqual(outcome_name(result.outcome), name, result.reason)

    def test_both_robots_drive_at_once_each_to_its_own_place(self):
        request = self.client.send("(and (robot_at ann kitchen) (robot_at bob bathroom))")
        self.drives.wait(2)
        self.let_go(*ROBOTS)
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")
        self.assertEqual([self.position(robot) for robot in ROBOTS], ["kitchen", "bathroom"])

    def test_robots_go_on_to_their_next_drives_each_by_itself(self):
        self.let_go(*ROBOTS)
        goal = "(and (visited kitchen) (visited bathroom) (visited dorm_room) (visited main_door))"
        self.assertOutcome(self.client.execute(goal, LONG), "SUCCEEDED")
        self.assertEqual(len(self.knowledge.facts("visited")), 4)

    def test_a_cancel_stops_both_robots(self):
        request = self.client.send("(and (robot_at ann dorm_room) (robot_at bob main_door))")
        self.drives.wait(2)
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "CANCELLED")
        self.drives.wait(0)
        self.assertEqual([self.position(robot) for robot in ROBOTS], ["anywhere", "anywhere"])

    def test_when_one_of_two_that_drive_leaves_the_other_one_is_stopped(self):
        request = self.client.send("(and (robot_at ann bathroom) (robot_at bob kitchen))")
        self.drives.wait(2)
        self.available["ann"](False)
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "PLANNER_ERROR")  # no other robot is ann, and no status says so
        self.assertIn("robot ann was taken out by its operator", request.result.reason)
        self.drives.wait(0)
        self.assertEqual([self.position(robot) for robot in ROBOTS], ["anywhere", "anywhere"])

    def test_a_cancel_stops_the_robot_that_drives(self):
        request = self.client.send("(robot_at bob dorm_room)")
        self.assertEqual(self.drives.wait(1), ["bob"])
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "CANCELLED")
        self.drives.wait(0)
        self.assertEqual(self.position("bob"), "anywhere")

    def test_the_goal_of_a_robot_that_leaves_is_planned_for_the_other_one(self):
        request = self.client.send("(visited main_door)")
        (driving,) = self.drives.wait(1)
        other = next(robot for robot in ROBOTS if robot != driving)
        self.let_go(other)
        self.available[driving](False)
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")
        self.assertEqual(self.position(other), "main_door")
        self.assertEqual(self.position(driving), "anywhere")


if __name__ == "__main__":
    init_node("over_rosplan_robots_test")
    rostest.rosrun("merlin_test", rospy.get_name().strip("/"), RobotsOverROSPlan)
