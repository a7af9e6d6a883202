#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Simulators that cannot start end with one line that says why, and a code that is not zero."""

import subprocess
import tempfile
import unittest
from pathlib import Path

import rospy
from rosgraph_msgs.msg import Clock

import rostest
from merlin_test.node_path import node_path
from merlin_test.topic_links import init_node

WORLD = Path(__file__).resolve().parents[3] / "src" / "merlin_sim" / "worlds" / "apartment.yaml"


def start(*parameters):
    done = subprocess.run(
        [node_path("merlin_sim", "merlin_sim"), *parameters], capture_output=True, text=True, timeout=180
    )
    # With a latched clock of its own the node stamps its log with simulated time; the text is what counts.
    lines = [line for line in (done.stdout + done.stderr).splitlines() if "merlin_sim:" in line]
    return done.returncode, lines


class Errors(unittest.TestCase):
    def refused(self, words, *parameters):
        code, lines = start(*parameters)
        self.assertEqual(code, 2)
        self.assertEqual(len(lines), 1, lines)
        for word in words:
            self.assertIn(word, lines[0])

    def test_missing_world(self):
        self.refused(["/nowhere/flat.yaml", "No such file"], "_world:=/nowhere/flat.yaml")

    def test_a_world_that_breaks_the_schema(self):
        text = WORLD.read_text().replace("x: 7.6, y: 1.2", "x: seven, y: 1.2")
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            file.write(text)
            file.flush()
            self.refused(["points_of_interest.kitchen.x", "'seven'"], f"_world:={file.name}")

    def test_a_robot_without_a_start(self):
        self.refused(["no start left", "r5"], f"_world:={WORLD}", "_robots:=[r1, r2, r3, r4, r5]")

    def test_robots_that_cannot_be_told_apart_or_placed(self):
        self.refused(["twice"], f"_world:={WORLD}", "_robots:=['', robot]")
        self.refused(["r1", "yaw"], f"_world:={WORLD}", "_robots:=[{namespace: r1, yaw: 1.0}]")

    def test_a_description_of_no_robot(self):
        self.refused(["~urdf", "not a robot"], f"_world:={WORLD}", f"_urdf:={WORLD}")

    def test_a_second_clock(self):
        clock = rospy.Publisher("/clock", Clock, queue_size=1)
        try:
            self.refused(["already publishes /clock"], f"_world:={WORLD}")
        finally:
            clock.unregister()


if __name__ == "__main__":
    init_node("simulator_errors_test")
    rostest.rosrun("merlin_test", "simulator_errors", Errors)
