#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The Executor and the actions over a planning system that behaves as the original ROSPlan does."""

import unittest

import rospy
import rosservice

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.announced_interfaces import wait_for_interfaces
from merlin_test.held_drives import HeldDrives
from merlin_test.topic_links import init_node


class OverROSPlan(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = MerlinExecutorClient()
        cls.knowledge = MerlinROSPlanAssistant()
        assert cls.client.wait_for_executor(LONG)
        # What this dispatcher sends before they listen, it latches, and waits for its end for ever.
        wait_for_interfaces("navigate", "ask")

    def setUp(self):
        for poi in ("kitchen", "bathroom", "dorm_room"):
            self.knowledge.remove_facts(f"(checked {poi})")

    def tearDown(self):
        self.assertEqual(self.knowledge.goals(), [])
        self.assertEqual(len(self.knowledge.facts("robot_at")), 1)

    def assertOutcome(self, result, name):
        self.assertEqual(outcome_name(result.outcome), name, result.reason)

    def test_none_of_our_own_services_is_there(self):
        names = rosservice.get_service_list()
        self.assertNotIn("/rosplan_knowledge_base/apply_effects", names)

    def test_goals_are_carried_out_one_after_the_other(self):
        for poi in ("kitchen", "bathroom", "kitchen"):
            self.knowledge.remove_facts(f"(checked {poi})")
            result = self.client.execute(f"(checked {poi})", LONG)
            self.assertOutcome(result, "SUCCEEDED")
            self.assertEqual(self.knowledge.facts("robot_at"), [f"(robot_at {poi})"])

    def test_a_cancel_stops_the_robot_and_the_next_goal_is_its_own(self):
        self.assertOutcome(self.client.execute("(checked kitchen)", LONG), "SUCCEEDED")
        drives = HeldDrives()
        self.addCleanup(drives.end)
        for poi in ("bathroom", "dorm_room"):
            drives.hold()
            request = self.client.send(f"(checked {poi})")
            drives.wait_driving()
            request.cancel()
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, "CANCELLED")
            drives.wait_stopped()
            self.assertEqual(self.knowledge.facts("robot_at"), ["(robot_at anywhere)"])
        self.assertOutcome(self.client.execute("(checked bathroom)", LONG), "SUCCEEDED")
        self.assertFalse(self.knowledge.holds("(checked dorm_room)"))

    def test_cancels_at_any_moment_do_no_harm(self):
        for number in range(12):
            request = self.client.send("(checked dorm_room)")
            request.wait(0.02 * number + 0.001)
            request.cancel()
            self.assertTrue(request.wait(LONG))
            self.knowledge.remove_facts("(checked dorm_room)")
        self.assertOutcome(self.client.execute("(checked kitchen)", LONG), "SUCCEEDED")

    def test_a_failed_action_is_noticed(self):
        rospy.set_param("world/points_of_interest/dorm_room", {"x": "nowhere"})
        self.addCleanup(rospy.set_param, "world/points_of_interest/dorm_room", {"x": 1, "y": 4, "yaw": 0})
        result = self.client.execute("(checked dorm_room)", LONG)
        self.assertOutcome(result, "ACTION_FAILED")
        self.assertIn("navigate", result.action)
        self.assertIn("dorm_room", result.reason)


if __name__ == "__main__":
    init_node("over_rosplan_test")
    rostest.rosrun("merlin_test", rospy.get_name().strip("/"), OverROSPlan)
