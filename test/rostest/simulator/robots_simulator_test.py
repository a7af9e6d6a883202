#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Two robots of one simulated world carry out one plan, each with its own sensors and its own guard."""

import math
import threading
import unittest

import rosgraph
import rospy
import tf2_ros
from merlin_msgs.msg import DispatchStatus, RobotWay
from merlin_msgs.srv import CaptureImage
from nav_msgs.msg import Odometry
from rosplan_dispatch_msgs.msg import ActionDispatch
from sensor_msgs.msg import LaserScan

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test.topic_links import init_node, patient_service, wait_for_publishers

LONG = 600.0  # s of wall time
ROBOTS = ("ann", "bob")


def publishers():
    return dict(rosgraph.Master("/test").getSystemState()[0])


class RobotsSimulator(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.changed = threading.Condition()
        cls.poses, cls.scans, cls.drives, cls.ways = {}, {}, {}, {}
        cls.under_way = []  # robots whose drives run, of each status of the dispatcher
        cls.subscribers = [
            subscriber
            for robot in ROBOTS
            for subscriber in (
                rospy.Subscriber(f"{robot}/ground_truth", Odometry, cls.moved, robot, tcp_nodelay=True),
                rospy.Subscriber(f"{robot}/scan", LaserScan, cls.scanned, robot, tcp_nodelay=True),
            )
        ]
        cls.subscribers.append(
            rospy.Subscriber("rosplan_plan_dispatcher/action_dispatch", ActionDispatch, cls.dispatched)
        )
        cls.subscribers.append(
            rospy.Subscriber("rosplan_plan_dispatcher/dispatch_status", DispatchStatus, cls.dispatches)
        )
        cls.subscribers.append(rospy.Subscriber("robot_ways", RobotWay, cls.told))
        cls.knowledge = MerlinROSPlanAssistant()
        cls.client = MerlinExecutorClient()
        assert cls.client.wait_for_executor(LONG)
        wait_for_publishers(*cls.subscribers)
        for robot in ROBOTS:
            assert cls.until(lambda robot=robot: cls.knowledge.holds(f"(available {robot})")), robot

    @classmethod
    def until(cls, happens):
        with cls.changed:  # each odometry of a robot looks again
            return cls.changed.wait_for(happens, LONG)

    @classmethod
    def moved(cls, message, robot):
        with cls.changed:
            cls.poses[robot] = message
            cls.changed.notify_all()

    @classmethod
    def scanned(cls, message, robot):
        with cls.changed:
            cls.scans[robot] = message
            cls.changed.notify_all()

    @classmethod
    def told(cls, message):
        with cls.changed:
            cls.ways[message.robot] = message
            cls.changed.notify_all()

    @classmethod
    def dispatched(cls, message):
        if message.name == "drive":
            parameters = {entry.key: entry.value for entry in message.parameters}
            with cls.changed:
                cls.drives[parameters["r"]] = parameters["to"]

    @classmethod
    def dispatches(cls, message):
        with cls.changed:
            cls.under_way.append(
                {entry.value for action in message.running for entry in action.parameters if entry.key == "r"}
            )
            cls.changed.notify_all()

    def test_each_has_its_own_frames_sensors_and_guard(self):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        self.assertTrue(self.until(lambda: set(self.poses) == set(self.scans) == set(ROBOTS)))
        for robot in ROBOTS:
            self.assertEqual(self.scans[robot].header.frame_id, f"{robot}/base_laser")
            topic, guard = f"/{robot}/cmd_vel", [f"/{robot}/merlin_guard"]
            self.assertTrue(self.until(lambda t=topic, g=guard: publishers().get(t) == g), publishers())
            capture = patient_service(f"{robot}/camera/capture", CaptureImage)
            self.assertTrue(capture.wait(LONG))
            picture = capture()
            self.assertTrue(picture.success, picture.message)
            self.assertEqual(picture.image.header.frame_id, f"{robot}/camera_optical_frame")
            for frame in ("base_laser", "camera_optical_frame"):
                self.assertTrue(
                    self.until(lambda f=f"{robot}/{frame}": buffer.can_transform("map", f, rospy.Time(0)))
                )
            where = buffer.lookup_transform(
                "map", f"{robot}/base_footprint", rospy.Time(0)
            ).transform.translation
            truth = self.poses[robot].pose.pose.position
            self.assertLess(math.hypot(where.x - truth.x, where.y - truth.y), 0.2)
        listener.unregister()

    def test_they_drive_to_two_places_at_once_under_one_plan(self):
        request = self.client.send("(and (visited dorm_room) (visited kitchen))")
        self.assertTrue(request.wait(LONG))
        result = request.result
        self.assertEqual(outcome_name(result.outcome), "SUCCEEDED", result.reason)
        # Messages on topics may come after the result.
        self.assertTrue(self.until(lambda: len(self.drives) == 2), self.drives)
        self.assertEqual(
            (set(self.drives), set(self.drives.values())), (set(ROBOTS), {"dorm_room", "kitchen"})
        )
        # Not when the bases moved: a busy machine may bring one of the goals late.
        self.assertTrue(self.until(lambda: set(ROBOTS) in self.under_way), self.under_way)
        for robot, place in self.drives.items():
            self.assertEqual(self.place(robot), place)

    def test_they_pass_each_other_on_their_ways_to_each_others_place(self):
        here = {robot: self.place(robot) for robot in ROBOTS}
        there = {"ann": here["bob"] or "kitchen", "bob": here["ann"] or "dorm_room"}
        request = self.client.send("(and " + " ".join(f"(robot_at {r} {there[r]})" for r in ROBOTS) + ")")
        self.assertTrue(request.wait(LONG))
        result = request.result
        self.assertEqual(outcome_name(result.outcome), "SUCCEEDED", result.reason)
        self.assertEqual({robot: self.place(robot) for robot in ROBOTS}, there)
        self.assertTrue(
            self.until(
                lambda: {name: way.driving for name, way in self.ways.items()} == dict.fromkeys(ROBOTS, False)
            )
        )

    def place(self, robot):
        """The place where it is by the knowledge, and by the truth; empty: anywhere."""
        (found,) = [fact for fact in self.knowledge.facts("robot_at") if robot in fact]
        place = found.strip("()").split()[-1]
        if place == "anywhere":
            return ""
        point = rospy.get_param(f"{robot}/world/points_of_interest/{place}")

        def there():
            truth = self.poses[robot].pose.pose.position
            return math.hypot(point["x"] - truth.x, point["y"] - truth.y) < 0.2

        self.assertTrue(self.until(there), f"{robot} at {place}")
        return place


if __name__ == "__main__":
    init_node("robots_simulator_test")
    rostest.rosrun("merlin_test", "robots_simulator", RobotsSimulator)
