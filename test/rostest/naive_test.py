#!/usr/bin/env python3
"""The naive arm: a cancel is read when the action has ended; its effects are true, the plan stops there."""

import threading
import unittest

import rospy
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from sound_play.msg import SoundRequestActionGoal

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

LONG = 60.0


class Naive(unittest.TestCase):
    def test_a_cancelled_drive_goes_on_to_its_end_and_the_plan_stops(self):
        client, knowledge = MerlinExecutorClient(), MerlinROSPlanAssistant()
        driving = threading.Event()
        drives, sentences = [], []
        rospy.Subscriber("move_base/goal", MoveBaseActionGoal, lambda message: driving.set())
        rospy.Subscriber("move_base/result", MoveBaseActionResult, lambda m: drives.append(m.status.status))
        rospy.Subscriber("sound_play/goal", SoundRequestActionGoal, sentences.append)
        self.assertTrue(client.wait_for_executor(LONG))
        first = client.execute("(checked bathroom)", LONG)
        self.assertEqual(outcome_name(first.outcome), "SUCCEEDED", first.reason)
        driving.clear()
        said = len(sentences)
        request = client.send("(checked kitchen)")
        self.assertTrue(driving.wait(LONG))
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "CANCELLED", request.result.reason)
        self.assertEqual(drives[-1], GoalStatus.SUCCEEDED)
        self.assertEqual(len(sentences), said)
        self.assertEqual(knowledge.facts("robot_at"), ["(robot_at kitchen)"])
        self.assertFalse(knowledge.holds("(checked kitchen)"))
        self.assertEqual(knowledge.goals(), [])
        again = client.execute("(checked kitchen)", LONG)
        self.assertEqual(outcome_name(again.outcome), "SUCCEEDED", again.reason)


if __name__ == "__main__":
    rospy.init_node("naive_test")
    rostest.rosrun("merlin_test", "naive", Naive)
