#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Timed knowledge under a simulated clock: on time, whatever the clock does."""

import unittest

import rospy
from merlin_msgs.msg import KnowledgeChanges
from rosgraph_msgs.msg import Clock

import rostest
from merlin_planning.knowledge_client import ADD, REMOVE, Update, fact, knowledge_client
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.topic_links import init_node, wait_for_connections


class TimedKnowledgeTest(unittest.TestCase):
    def setUp(self):
        self.clock = rospy.Publisher("/clock", Clock, queue_size=10)
        self.changes = Received("rosplan_knowledge_base/changes", KnowledgeChanges)
        self.addCleanup(self.changes.close)
        self.addCleanup(self.clock.unregister)
        self.knowledge = knowledge_client()
        # a waiter in rospy waits for the clock: the wait must not stop it
        wait_for_connections(self.clock, count=2)
        self.assertTrue(self.knowledge.wait(LONG), "no knowledge base")

    def wait_for(self, name):
        self.changes.wait(lambda change: name in [item.values[0].value for item in change.added])

    def set_clock(self, seconds):
        """Moves the clock and waits until the knowledge base has seen it: it stamps what it takes."""
        kitchen = fact("checked", "kitchen")
        stamp = None
        while stamp != rospy.Time.from_sec(seconds):
            self.clock.publish(Clock(rospy.Time.from_sec(seconds)))
            self.knowledge.update([Update(ADD, kitchen)])
            found = self.knowledge.propositions("checked")
            stamp = next(item.initial_time for item in found if item.values[0].value == "kitchen")
            self.knowledge.update([Update(REMOVE, kitchen)])

    def timed(self, name, seconds):
        item = fact("checked", name)
        item.initial_time = rospy.Time.from_sec(seconds)
        self.knowledge.update([Update(ADD, item)])

    def known(self):
        return [item.values[0].value for item in self.knowledge.propositions("checked")]

    def test_clock_that_moves_stops_and_jumps_back(self):
        self.set_clock(10.0)
        self.timed("bathroom", 20.0)
        self.timed("main_door", 40.0)
        self.set_clock(19.9)
        self.assertEqual(self.known(), [])
        self.set_clock(20.0)
        self.wait_for("bathroom")
        self.set_clock(5.0)  # a simulator that was reset
        self.timed("dorm_room", 6.0)
        self.set_clock(6.5)
        self.wait_for("dorm_room")
        self.assertEqual(self.known(), ["bathroom", "dorm_room"])
        self.set_clock(100.0)
        self.wait_for("main_door")
        self.assertEqual(self.known(), ["bathroom", "dorm_room", "main_door"])


if __name__ == "__main__":
    init_node("timed_knowledge_test")
    rostest.rosrun("merlin_test", "timed_knowledge", TimedKnowledgeTest)
