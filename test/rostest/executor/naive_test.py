#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The naive arm: a cancel is read when the action has ended; its effects are true, the plan stops there."""

import unittest

import rospy
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from rosplan_dispatch_msgs.msg import ActionDispatch
from sound_play.msg import SoundRequestActionGoal

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.held_drives import HeldDrives
from merlin_test.knowledge_fixture import Received
from merlin_test.topic_links import init_node


class Naive(unittest.TestCase):
    def test_a_cancelled_drive_goes_on_to_its_end_and_the_plan_stops(self):
        client, knowledge = MerlinExecutorClient(), MerlinROSPlanAssistant()
        goals = Received("move_base/goal", MoveBaseActionGoal)
        results = Received("move_base/result", MoveBaseActionResult)
        sentences = Received("sound_play/goal", SoundRequestActionGoal)
        dispatches = Received("rosplan_plan_dispatcher/action_dispatch", ActionDispatch)
        drives = HeldDrives()
        self.addCleanup(drives.end)
        self.assertTrue(client.wait_for_executor(LONG))
        first = client.execute("(checked bathroom)", LONG)
        self.assertEqual(outcome_name(first.outcome), "SUCCEEDED", first.reason)
        earlier = goals.wait(lambda _: True)
        sentences.wait(lambda _: True)
        drives.hold()
        request = client.send("(checked kitchen)")
        drive = goals.wait(lambda goal: goal.goal_id.id != earlier.goal_id.id).goal_id.id
        drives.wait_driving()
        request.cancel()
        # The end of the first plan is latched as a cancel, too.
        second = dispatches.wait(lambda each: "kitchen" in [value.value for value in each.parameters])
        dispatches.wait(lambda each: (each.name, each.plan_id) == ("cancel_action", second.plan_id))
        drives.end()
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "CANCELLED", request.result.reason)
        ended = results.wait(lambda result: result.status.goal_id.id == drive)
        self.assertEqual(ended.status.status, GoalStatus.SUCCEEDED)
        self.assertEqual(knowledge.facts("robot_at"), ["(robot_at kitchen)"])
        self.assertFalse(knowledge.holds("(checked kitchen)"))
        self.assertEqual(knowledge.goals(), [])
        now = rospy.Time.now()
        again = client.execute("(checked kitchen)", LONG)
        self.assertEqual(outcome_name(again.outcome), "SUCCEEDED", again.reason)
        sentences.wait(lambda sentence: sentence.goal_id.stamp > now)
        self.assertEqual(len(sentences.messages), 2, "the cancelled plan said something")


if __name__ == "__main__":
    init_node("naive_test")
    rostest.rosrun("merlin_test", "naive", Naive)
