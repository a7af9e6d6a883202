#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""recognize as its clients use it: what stands where, cancels, and why there is no answer."""

import threading
import time
import unittest

import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from merlin_msgs.msg import RecognizeAction, RecognizeGoal
from merlin_msgs.srv import CaptureImage
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

import rostest
import smach
from merlin_ros.actions.action_client import ActionClient
from merlin_sm.state_factory import MerlinStateFactory
from merlin_test import LONG
from merlin_test.topic_links import init_node, patient_service

TRUTH = {
    "cup": (1.5, 0.4, 0.80),
    "coffee": (1.7, -0.35, 0.80),
    "plate": (1.4, 0.1, 0.76),
    "dirty_plate": (1.35, -0.2, 0.76),
    "juice": (2.3, -0.5, 1.165),
    "person": (3.2, 0.8, 0.85),
    "tag_7": (1.668, 0.6, 0.83),
}
SERVERS = ("r1", "topic", "blind", "silent", "lost")


class Recognition(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.clients = {name: ActionClient(f"/{name}/recognize", RecognizeAction) for name in SERVERS}
        for name, client in cls.clients.items():
            assert client.wait_for_server(LONG), f"{name}/recognize is there"
        cls.pause = patient_service("/merlin_sim/pause", Trigger)
        cls.resume = patient_service("/merlin_sim/resume", Trigger)
        capture = patient_service("/r1/camera/capture", CaptureImage)
        for service in (cls.pause, cls.resume, capture):
            assert service.wait(LONG), "the simulator has started"
        # The first picture starts the process that draws it. A look would not wait so long, and ask again.
        picture = capture()
        assert picture.success, picture.message
        rospy.wait_for_message("/r1/odom", rospy.AnyMsg, timeout=LONG)
        # The robot's fixed frames come last; then a look succeeds.
        end = time.monotonic() + LONG
        for server in ("r1", "topic"):
            while cls.look(server=server).status != GoalStatus.SUCCEEDED:
                assert time.monotonic() < end, f"a look of {server} succeeds once everything has started"

    @classmethod
    def look(cls, *classes, server="r1"):
        goal = cls.clients[server].send(RecognizeGoal(classes=classes))
        assert goal.wait(LONG), "a look ends"
        return goal

    def check(self, result):
        found = {}
        for detection in result.detections.detections:
            found.setdefault(result.names[detection.results[0].id], []).append(detection)
        self.assertEqual(sorted(found), sorted(TRUTH))
        for name, place in TRUTH.items():
            self.assertEqual(len(found[name]), 1, name)
            hypothesis = found[name][0].results[0]
            self.assertTrue(0.5 <= hypothesis.score <= 1.0, (name, hypothesis.score))
            seen = found[name][0].bbox.center.position
            # A few centimetres of it are the error of the localisation.
            for value, expected in zip((seen.x, seen.y, seen.z), place):
                self.assertAlmostEqual(value, expected, delta=0.15, msg=name)
            self.assertEqual(hypothesis.pose.pose, found[name][0].bbox.center)
            self.assertGreater(hypothesis.pose.covariance[0], 0.0)

    def test_what_stands_where(self):
        before = rospy.get_rostime()
        goal = self.look()
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED, goal.text)
        self.assertEqual(goal.result.detections.header.frame_id, "map")
        self.assertGreaterEqual(goal.result.detections.header.stamp, before)
        self.check(goal.result)
        self.assertIn("1 cup", goal.text)
        image = rospy.wait_for_message("/r1/recognition/image", Image, timeout=LONG)
        self.assertEqual((image.width, image.height, image.encoding), (640, 480, "rgb8"))
        self.assertEqual(image.header.frame_id, "r1/camera_optical_frame")

    def test_classes_are_a_filter(self):
        goal = self.look("cup", "tag", "bottle")
        self.assertEqual(sorted(goal.result.names), ["cup", "tag_7"])
        goal = self.look("cake")
        self.assertEqual((goal.status, goal.result.names), (GoalStatus.SUCCEEDED, []))
        self.assertEqual(goal.text, "saw nothing of cake")

    def test_it_works_while_time_stands_still(self):
        self.assertTrue(self.pause().success)
        self.addCleanup(self.resume)
        for _ in range(2):
            self.check(self.look().result)

    def test_the_topic_of_a_camera_serves_as_well(self):
        goal = self.look(server="topic")
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED, goal.text)
        self.check(goal.result)

    def test_nonsense_is_refused(self):
        goal = self.look("cup", "unicorn")
        self.assertEqual(goal.status, GoalStatus.ABORTED)
        self.assertIn("unknown class 'unicorn'; known: cup, coffee,", goal.text)

    def test_without_image_or_frame_it_says_what_is_missing(self):
        for server, words in (
            ("blind", "no camera image: service /blind/camera/capture does not answer"),
            ("silent", "no camera image: nothing came on /nobody/image_raw within 6 s"),
            ("lost", "no transform from r1/camera_optical_frame to moon"),
        ):
            goal = self.look(server=server)
            self.assertEqual(goal.status, GoalStatus.ABORTED, server)
            self.assertIn(words, goal.text)
        told = threading.Event()

        def receive(message):
            if any("nothing came on /nobody/image_raw" in status.message for status in message.status):
                told.set()

        diagnostics = rospy.Subscriber("/diagnostics", DiagnosticArray, receive)
        self.addCleanup(diagnostics.unregister)
        self.assertTrue(told.wait(LONG), "the diagnostics report a recogniser without a camera")

    def test_a_cancel_ends_a_look_that_waits(self):
        goal = self.clients["silent"].send(RecognizeGoal())
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        self.assertIn(goal.status, (GoalStatus.PREEMPTED, GoalStatus.RECALLED))
        # And the next one is served.
        goal = self.look("unicorn", server="silent")
        self.assertEqual(goal.status, GoalStatus.ABORTED)

    def test_a_look_that_runs_can_be_cancelled(self):
        goal = self.clients["r1"].send(RecognizeGoal())
        goal.cancel()
        self.assertTrue(goal.wait(LONG))
        self.assertNotIn(goal.status, (GoalStatus.ABORTED, GoalStatus.LOST))
        self.assertEqual(self.look("cup").status, GoalStatus.SUCCEEDED)

    def test_the_ready_state_gives_what_was_seen(self):
        machine = smach.StateMachine(
            outcomes=["succeeded", "aborted", "preempted"], output_keys=["detections"]
        )
        factory = MerlinStateFactory()
        with machine:
            smach.StateMachine.add(
                "LOOK", factory.create("recognize", classes=["cup", "plate"], action="/r1/recognize")
            )
        self.assertEqual(machine.execute(), "succeeded")
        seen = dict(machine.userdata.detections)
        self.assertEqual(sorted(seen), ["cup", "plate"])
        self.assertAlmostEqual(seen["cup"].bbox.center.position.x, TRUTH["cup"][0], delta=0.15)


if __name__ == "__main__":
    init_node("recognition_test")
    rostest.rosrun("merlin_test", "recognition", Recognition)
