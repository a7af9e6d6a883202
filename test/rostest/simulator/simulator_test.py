#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The simulator as its users see it: topics, frames, services, two robots."""

import math
import subprocess
import threading
import unittest
from pathlib import Path

import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from merlin_msgs.msg import SimStatus
from merlin_msgs.srv import SetRealTimeFactor, SetSeed
from nav_msgs.msg import OccupancyGrid, Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

import rostest
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.topic_links import init_node, patient_service, wait_for_connections

WORLD = Path(__file__).resolve().parents[3] / "src" / "merlin_sim" / "worlds" / "apartment.yaml"
SLOW = 0.25  # real-time factor that a machine with much else to do reaches, too
ODOMETRY_PERIOD = 50_000_000  # ns


class Latest:
    """The latest message of a topic, and a wait for one that a predicate likes."""

    def __init__(self, topic, kind):
        self.changed = threading.Condition()
        self.message = None
        self.subscriber = rospy.Subscriber(topic, kind, self.receive, tcp_nodelay=True)

    def receive(self, message):
        with self.changed:
            self.message = message
            self.changed.notify_all()

    def wait(self, predicate=lambda _: True):
        with self.changed:
            if not self.changed.wait_for(
                lambda: self.message is not None and predicate(self.message), timeout=LONG
            ):
                raise AssertionError(f"{self.subscriber.name}: not within {LONG} s; last: {self.message}")
            return self.message


def drive(topic, speed, turn):
    publisher = rospy.Publisher(topic, Twist, queue_size=5)
    wait_for_connections(publisher)
    twist = Twist()
    twist.linear.x, twist.angular.z = speed, turn
    return publisher, twist


class Simulator(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.truth = {name: Latest(f"/{name}/ground_truth", Odometry) for name in ("r1", "r2")}
        cls.odom = Latest("/r1/odom", Odometry)
        cls.scan = Latest("/r1/scan", LaserScan)
        assert patient_service("/merlin_sim/pause", Trigger).wait(LONG), "the simulator has started"
        cls.status = Latest("/merlin_sim/status", SimStatus)
        cls.map = Latest("/map", OccupancyGrid)
        cls.buffer = tf2_ros.Buffer()
        cls.listener = tf2_ros.TransformListener(cls.buffer)

    def keep_driving(self, publisher, twist, until):
        """Commands like a controller does, once per odometry, until a pose of the truth pleases."""

        def again(_):
            publisher.publish(twist)

        commander = rospy.Subscriber("/r1/odom", Odometry, again, tcp_nodelay=True)
        try:
            return self.truth["r1"].wait(until)
        finally:
            commander.unregister()

    def test_a_robot_drives_and_stops_and_the_other_one_stands(self):
        before = self.truth["r1"].wait().pose.pose.position.x
        other = self.truth["r2"].wait().pose.pose.position
        moves = []
        recorder = rospy.Subscriber("/r1/ground_truth", Odometry, moves.append, tcp_nodelay=True)
        self.addCleanup(recorder.unregister)
        publisher, twist = drive("/r1/cmd_vel", 0.3, 0.0)
        self.keep_driving(publisher, twist, lambda m: m.pose.pose.position.x > before + 0.3)
        publisher.publish(Twist())
        stopped = self.truth["r1"].wait(lambda m: abs(m.twist.twist.linear.x) < 0.01)
        fast = [move for move in list(moves) if move.twist.twist.linear.x > 0.28]
        # 0.3 m/s at 1 m/s² need 0.045 m, from when the robot has heard of it.
        self.assertLess(stopped.pose.pose.position.x, fast[-1].pose.pose.position.x + 0.08)
        now = self.truth["r2"].wait().pose.pose.position
        self.assertAlmostEqual(now.x, other.x, delta=0.005)
        self.assertAlmostEqual(now.y, other.y, delta=0.005)

    def test_a_silent_commander_is_forgotten(self):
        publisher, twist = drive("/r1/cmd_vel", 0.0, 0.5)
        self.keep_driving(publisher, twist, lambda m: m.twist.twist.angular.z > 0.4)
        self.truth["r1"].wait(lambda m: abs(m.twist.twist.angular.z) < 0.01)

    def test_odometry_and_frames_agree_with_the_truth(self):
        self.odom.wait()
        transform = self.buffer.lookup_transform(
            "map", "r1/base_footprint", rospy.Time(0), rospy.Duration(LONG)
        )
        stamp = transform.header.stamp
        truth = self.truth["r1"].wait(lambda m: m.header.stamp >= stamp).pose.pose.position
        move = transform.transform.translation
        self.assertLess(math.hypot(move.x - truth.x, move.y - truth.y), 0.15)
        self.assertEqual(self.odom.message.header.frame_id, "r1/odom")
        self.assertEqual(self.odom.message.child_frame_id, "r1/base_footprint")

    def test_the_laser_sees_the_other_robot(self):
        stands = self.truth["r1"].wait(lambda m: abs(m.twist.twist.angular.z) < 0.01)
        scan = self.scan.wait(lambda m: m.header.stamp >= stands.header.stamp)
        one = stands.pose.pose
        two = self.truth["r2"].wait().pose.pose.position
        distance = math.hypot(two.x - one.position.x, two.y - one.position.y)
        bearing = math.atan2(two.y - one.position.y, two.x - one.position.x)
        bearing -= 2 * math.atan2(one.orientation.z, one.orientation.w)
        ray = round((math.remainder(bearing, 2 * math.pi) - scan.angle_min) / scan.angle_increment)
        self.assertAlmostEqual(scan.ranges[ray % len(scan.ranges)], distance - 0.25, delta=0.08)

    def test_the_map_is_there_for_whoever_comes_late(self):
        grid = rospy.wait_for_message("/map", OccupancyGrid, LONG)
        self.assertEqual(grid.header.frame_id, "map")
        self.assertEqual(len(grid.data), grid.info.width * grid.info.height)
        self.assertEqual(set(grid.data), {-1, 0, 100})

    def test_time_stands_still_while_paused_and_goes_on(self):
        pause = patient_service("/merlin_sim/pause", Trigger)
        resume = patient_service("/merlin_sim/resume", Trigger)
        self.assertTrue(pause().success)
        self.addCleanup(resume)
        one = self.status.wait(lambda m: m.paused).header.stamp
        number = self.status.message.header.seq
        two = self.status.wait(lambda m: m.header.seq > number).header.stamp
        self.assertEqual(one, two)
        self.assertTrue(resume().success)
        self.status.wait(lambda m: not m.paused)
        self.truth["r1"].wait(lambda m: m.header.stamp > two)

    def test_the_clock_of_a_fast_simulation_comes_as_odometry_does(self):
        ticks = []
        clock = Latest("/clock", Clock)
        self.addCleanup(clock.subscriber.unregister)
        recorder = rospy.Subscriber("/clock", Clock, lambda message: ticks.append(message.clock))
        self.addCleanup(recorder.unregister)
        change = patient_service("/merlin_sim/set_real_time_factor", SetRealTimeFactor)
        self.addCleanup(change, 4.0)
        self.assertTrue(change(1.0).success)
        clock.wait(lambda message: message.clock.to_nsec() % ODOMETRY_PERIOD != 0)
        self.assertTrue(change(0.0).success)
        fast = self.status.wait(lambda message: message.requested_factor == 0.0).header.stamp
        fast += rospy.Duration(0.1)  # the step under way began before
        clock.wait(lambda message: message.clock > fast + rospy.Duration(1.0))
        self.assertEqual([t for t in list(ticks) if t > fast and t.to_nsec() % ODOMETRY_PERIOD != 0], [])

    def test_a_factor_beyond_the_machine_is_in_the_diagnostics(self):
        change = patient_service("/merlin_sim/set_real_time_factor", SetRealTimeFactor)
        self.addCleanup(change, 4.0)
        health = Latest("/diagnostics", DiagnosticArray)
        self.assertTrue(change(1000.0).success)
        told = health.wait(lambda m: any("reaches factor" in status.message for status in m.status))
        self.assertEqual(told.status[0].name, "merlin_sim: world")
        self.assertTrue(change(SLOW).success)
        health.wait(lambda m: m.status[0].name == "merlin_sim: world" and m.status[0].level == 0)

    def test_the_factor_changes_and_nonsense_is_refused(self):
        change = patient_service("/merlin_sim/set_real_time_factor", SetRealTimeFactor)
        self.addCleanup(change, 4.0)
        self.assertTrue(change(SLOW).success)
        self.status.wait(
            lambda m: m.requested_factor == SLOW and 0.9 < m.achieved_factor / m.requested_factor < 1.1
        )
        for nonsense in (-1.0, float("nan"), float("inf")):
            answer = change(nonsense)
            self.assertFalse(answer.success)
            self.assertIn("not allowed", answer.message)

    def test_a_second_simulator_ends_with_one_line_that_says_why(self):
        command = [node_path("merlin_sim", "merlin_sim"), "__name:=second", f"_world:={WORLD}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONG)
        # The node stamps its log with simulated time; the text is what counts.
        lines = [line for line in (done.stdout + done.stderr).splitlines() if "second:" in line]
        self.assertEqual((done.returncode, len(lines)), (2, 1), done)
        self.assertIn("/merlin_sim already publishes /clock", lines[0])

    def scans_after(self, begin_anew, enough):
        """Scans of a new world, by the time since it began."""
        old = self.map.wait().info.map_load_time
        self.assertTrue(begin_anew().success)
        begun = self.map.wait(lambda grid: grid.info.map_load_time > old).info.map_load_time

        def found():  # scans of the old world come late
            new = [scan for scan in list(self.scans) if scan.header.stamp > begun]
            return {(scan.header.stamp - begun).to_nsec(): scan.ranges for scan in new}

        self.scan.wait(lambda _: enough(found()))
        return found()

    def test_the_world_begins_anew_and_the_same_seed_gives_the_same_noise(self):
        self.scans = []
        listener = rospy.Subscriber("/r1/scan", LaserScan, self.scans.append, tcp_nodelay=True)
        self.addCleanup(listener.unregister)
        change = patient_service("/merlin_sim/set_seed", SetSeed)
        before = self.truth["r1"].wait().header.stamp

        def shared(scans):
            return set(one) & set(scans)

        one = self.scans_after(lambda: change(9), lambda scans: len(scans) >= 20)
        self.status.wait(lambda m: m.seed == 9)
        reset = patient_service("/merlin_sim/reset", Trigger)
        two = self.scans_after(reset, lambda scans: len(shared(scans)) > 10)
        other = self.scans_after(lambda: change(10), lambda scans: len(shared(scans)) > 10)
        self.assertEqual([when for when in shared(two) if one[when] != two[when]], [])
        self.assertEqual([when for when in shared(other) if one[when] == other[when]], [])
        self.assertGreater(self.truth["r1"].wait().header.stamp, before)  # time goes on


if __name__ == "__main__":
    init_node("simulator_test")
    rostest.rosrun("merlin_test", "simulator", Simulator)
