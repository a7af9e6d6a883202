#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The node that docs/real-robot.md shows, as it stands there, between a detector and MERLIN."""

import re
import signal
import subprocess
import sys
import time
import unittest
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from merlin_msgs.msg import RecognizeAction, RecognizeGoal
from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

import rostest
from merlin_ros.actions.action_client import ActionClient
from merlin_test import LONG
from merlin_test.node_path import LEAN
from merlin_test.topic_links import init_node

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "real-robot.md"
CUP, PERSON = 0, 2
SILENT = "the detector sent nothing within 5 s"


def detection(number, x):
    hypothesis = ObjectHypothesisWithPose(id=number, score=0.9)
    hypothesis.pose.pose.position.x = x
    return Detection3D(results=[hypothesis])


class RecognitionAdapter(unittest.TestCase):
    def setUp(self):
        codes = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S)
        (code,) = (each for each in codes if 'init_node("recognition")' in each)
        self.adapter = subprocess.Popen([sys.executable, "-c", LEAN + code])
        self.addCleanup(self.adapter.wait, LONG)
        self.addCleanup(self.adapter.send_signal, signal.SIGINT)
        self.client = ActionClient("recognize", RecognizeAction)
        self.assertTrue(self.client.wait_for_server(LONG))

    def look(self, *classes):
        goal = self.client.send(RecognizeGoal(classes=classes))
        self.assertTrue(goal.wait(LONG))
        return goal

    def cancelled(self):
        """A goal whose cancel came after it had begun."""
        goal = self.client.send(RecognizeGoal())
        begun = False
        while not begun:
            known = rospy.wait_for_message("recognize/status", GoalStatusArray, LONG).status_list
            begun = any(each.goal_id.id == goal.id and each.status != GoalStatus.PENDING for each in known)
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        return goal

    def test_a_cancel_ends_the_wait_for_the_detector(self):
        end = time.monotonic() + LONG
        while (goal := self.cancelled()).text == SILENT:  # a busy machine cancels too late
            self.assertLess(time.monotonic(), end, SILENT)
        self.assertEqual(goal.status, GoalStatus.PREEMPTED, goal.text)

    def test_detections_reach_whoever_asks_for_them(self):
        silent = self.look()
        self.assertEqual((silent.status, silent.text), (GoalStatus.ABORTED, SILENT))
        detector = rospy.Publisher("detections", Detection3DArray, latch=True, queue_size=1)
        self.addCleanup(detector.unregister)
        detector.publish(Detection3DArray(detections=[detection(CUP, 1.0), detection(PERSON, 2.0)]))
        for classes, expected in (((), [1.0, 2.0]), (("person",), [2.0]), (("bottle",), [])):
            end = time.monotonic() + LONG
            while (goal := self.look(*classes)).text == SILENT:  # a busy machine needs longer to connect them
                self.assertLess(time.monotonic(), end, SILENT)
            self.assertEqual(goal.status, GoalStatus.SUCCEEDED, goal.text)
            seen = goal.result.detections.detections
            self.assertEqual([found.results[0].pose.pose.position.x for found in seen], expected)
            self.assertEqual(goal.result.names[PERSON], "person")


if __name__ == "__main__":
    init_node("recognition_adapter_test")
    rostest.rosrun("merlin_test", "recognition_adapter", RecognitionAdapter)
