# SPDX-License-Identifier: Apache-2.0
"""The simulated camera as its users see it: capture and stream."""

import math
import signal
import threading
import unittest
from pathlib import Path
from xmlrpc.client import ServerProxy

import numpy as np
import rosgraph
import rospy
from merlin_msgs.srv import CaptureImage
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from merlin_sim.rendering.picture_worker import NAME
from merlin_test import LONG
from merlin_test.process_signals import strike
from merlin_test.topic_links import patient_service


def picture_process():
    """The process that makes the simulator's pictures."""
    master = rosgraph.Master("/test")
    simulator = ServerProxy(master.lookupNode("/merlin_sim")).getPid("/test")[2]
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rsplit(")", 1)[1].split()[1])
            words = (path.parent / "cmdline").read_text().split("\0")
        except OSError:  # it has ended
            continue
        if parent == simulator and NAME in words:
            return int(path.parent.name)
    raise AssertionError("the simulator has no process of pictures")


class Camera(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.capture = patient_service("/camera/capture", CaptureImage)
        cls.pause = patient_service("/merlin_sim/pause", Trigger)
        cls.resume = patient_service("/merlin_sim/resume", Trigger)
        for service in (cls.capture, cls.pause, cls.resume):
            assert service.wait(LONG), "the simulator has started"

    def check(self, image, info):
        self.assertEqual((image.encoding, image.step), ("rgb8", 3 * image.width))
        self.assertEqual((info.width, info.height), (image.width, image.height))
        self.assertEqual(image.header.frame_id, "camera_optical_frame")
        self.assertEqual(info.header.stamp, image.header.stamp)
        self.assertEqual(info.header.frame_id, image.header.frame_id)
        # 70 degrees from edge to edge.
        self.assertAlmostEqual(info.K[0], image.width / 2 / math.tan(math.radians(35)), places=6)
        pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)
        # The plate in the middle of the table, below the guest's clothes.
        violet = (pixels[:, :, 2] > 150) & (pixels[:, :, 1] < 60)
        self.assertGreater(violet.sum(), 500)

    def test_a_picture_on_request(self):
        before = rospy.wait_for_message("/clock", Clock, timeout=LONG).clock
        answer = self.capture()
        self.assertTrue(answer.success, answer.message)
        self.assertGreaterEqual(answer.image.header.stamp, before)
        self.check(answer.image, answer.info)

    def test_while_paused_two_pictures_are_the_same(self):
        self.assertTrue(self.pause().success)
        self.addCleanup(self.resume)
        self.capture()  # the step under way when the service was called may end between two pictures
        one, two = self.capture(), self.capture()
        self.assertTrue(one.success and two.success)
        self.assertEqual(one.image.header.stamp, two.image.header.stamp)
        self.assertEqual(one.image.data, two.image.data)

    def test_a_process_of_pictures_that_dies_or_hangs_is_replaced(self):
        for number in (signal.SIGKILL, signal.SIGSTOP):
            self.assertTrue(self.capture().success)
            process = picture_process()
            strike(process, number)
            answer = self.capture()
            self.assertTrue(answer.success, answer.message)
            self.check(answer.image, answer.info)
            self.assertNotEqual(picture_process(), process)

    def test_several_pictures_at_once(self):
        answers = []
        callers = [
            threading.Thread(
                target=lambda: answers.append(patient_service("/camera/capture", CaptureImage)()),
                daemon=True,
            )
            for _ in range(4)
        ]
        for caller in callers:
            caller.start()
        for caller in callers:
            caller.join(LONG)
        self.assertEqual([answer.success for answer in answers], [True] * 4)
        for answer in answers:
            self.check(answer.image, answer.info)

    def test_the_stream(self):
        came = threading.Condition()
        messages = {}

        def keep(message):
            with came:
                messages.setdefault(type(message), {})[message.header.stamp] = message
                came.notify_all()

        listeners = [
            rospy.Subscriber("/camera/image_raw", Image, keep),
            rospy.Subscriber("/camera/camera_info", CameraInfo, keep),
        ]
        for listener in listeners:
            self.addCleanup(listener.unregister)

        def both():
            return set(messages.get(Image, {})) & set(messages.get(CameraInfo, {}))

        with came:
            self.assertTrue(came.wait_for(lambda: len(both()) >= 2, timeout=LONG))
            stamps = sorted(both())
        self.check(messages[Image][stamps[0]], messages[CameraInfo][stamps[0]])
        # 2 Hz of simulated time; a picture may have been lost on the way.
        self.assertAlmostEqual(math.remainder((stamps[1] - stamps[0]).to_sec(), 0.5), 0.0, places=3)
