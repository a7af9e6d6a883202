# SPDX-License-Identifier: Apache-2.0
"""The services that change the simulated world, as an application that plays the guests uses them."""

import math
import threading
import unittest

import rospy
from geometry_msgs.msg import Point
from merlin_msgs.msg import SimPeople, SimPerson
from merlin_msgs.srv import PlaceThing, WalkPerson
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

from merlin_test import LONG
from merlin_test.topic_links import patient_service, wait_for_publishers


class WorldControl(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.changed = threading.Condition()
        cls.people, cls.scan = {}, None
        cls.seen = []  # (when, person), of every message
        cls.place = patient_service("/merlin_sim/place", PlaceThing)
        cls.walk = patient_service("/merlin_sim/walk", WalkPerson)
        cls.call = {
            name: patient_service(f"/merlin_sim/{name}", Trigger) for name in ("pause", "resume", "reset")
        }
        for proxy in (cls.place, cls.walk, *cls.call.values()):
            assert proxy.wait(LONG), "the simulator has started"
        cls.subscribers = [
            rospy.Subscriber("/merlin_sim/people", SimPeople, cls.see_people, tcp_nodelay=True),
            rospy.Subscriber("/scan", LaserScan, cls.see_scan, tcp_nodelay=True),
        ]
        wait_for_publishers(*cls.subscribers)  # a walk that is not heard of from its begin is over soon

    @classmethod
    def tearDownClass(cls):
        for subscriber in cls.subscribers:
            subscriber.unregister()

    def setUp(self):
        self.assertTrue(self.call["reset"]().success)
        self.addCleanup(self.call["reset"])
        self.addCleanup(self.call["resume"])

    @classmethod
    def see_people(cls, message):
        with cls.changed:
            cls.people = {person.name: person for person in message.people}
            cls.seen += [(message.header.stamp, person) for person in message.people]
            cls.changed.notify_all()

    @classmethod
    def see_scan(cls, message):
        with cls.changed:
            cls.scan = message
            cls.changed.notify_all()

    def wait(self, predicate):
        with self.changed:
            if not self.changed.wait_for(predicate, timeout=LONG):
                raise AssertionError(f"not within {LONG} s: {self.people}")

    def person(self, name):
        return self.people.get(name, SimPerson())

    def test_a_guest_comes_in_walks_to_a_table_and_leaves(self):
        came = self.place(name="cleo", kind="person", x=5.0, y=1.6, yaw=1.57)
        self.assertTrue(came.success, came.message)
        walk = self.walk(name="cleo", path=[Point(3.0, 1.8, 0.0)], speed=1.0, turn=True, yaw=math.pi)
        self.assertTrue(walk.success, walk.message)
        self.assertGreaterEqual(walk.stamp, came.stamp)

        def seen(state, after):
            return [
                (when, person)
                for when, person in self.seen
                if (person.name, person.walk, person.state) == ("cleo", walk.walk, state) and when >= after
            ]

        self.wait(lambda: seen(SimPerson.WALKING, walk.stamp))
        left = seen(SimPerson.WALKING, walk.stamp)[0][0]
        self.wait(lambda: seen(SimPerson.STANDING, left))
        arrived, cleo = seen(SimPerson.STANDING, left)[0]
        self.assertAlmostEqual(cleo.x, 3.0)
        self.assertAlmostEqual(abs(cleo.yaw), math.pi)
        # 2.01 m at 1 m/s, in the simulator's time, not in ours
        self.assertAlmostEqual((arrived - walk.stamp).to_sec(), 2.01, delta=0.25)
        self.assertTrue(self.place(name="cleo", absent=True).success)
        self.wait(lambda: self.person("cleo").state == SimPerson.ABSENT)

    def test_the_laser_sees_who_was_placed_while_the_world_stood_still(self):
        self.assertTrue(self.call["pause"]().success)
        placed = self.place(name="barman", x=2.5, y=3.2)
        self.assertTrue(placed.success, placed.message)
        self.wait(lambda: abs(self.person("barman").x - 2.5) < 1e-9)
        self.assertTrue(self.call["resume"]().success)
        # The robot begins at (2.5, 4.2); he is on its left.
        self.wait(
            lambda: self.scan and self.scan.header.stamp > placed.stamp and self.scan.ranges[270] < 0.85
        )
        self.assertAlmostEqual(self.scan.ranges[270], 1.0 - 0.22, delta=0.05)

    def test_an_order_is_put_on_the_tray_and_on_a_table(self):
        put = self.place(name="order", kind="cup", on="robot")
        self.assertTrue(put.success, put.message)
        self.assertTrue(self.place(name="order", on="table_1", x=0.0, y=0.1).success)
        again = self.place(name="second", kind="cup", on="table_1", x=0.0, y=0.1)
        self.assertFalse(again.success)
        self.assertIn("order does", again.message)

    def test_what_cannot_be_is_refused_with_a_sentence(self):
        for answer, words in (
            (self.place(name="nobody"), "no person, object or furniture 'nobody'"),
            (self.place(name="guest_1", x=0.0, y=4.0), "outside the walls"),
            (self.place(name="guest_1", x=1.6, y=1.8), "table_1 is there"),
            (self.place(name="guest_1", x=float("nan")), "nan is not a place"),
            (self.walk(name="guest_1", path=[Point(7.6, 1.0, 0.0)]), "wall_"),
            (self.walk(name="nobody", path=[Point(3.0, 3.0, 0.0)]), "no person 'nobody'"),
        ):
            self.assertFalse(answer.success)
            self.assertIn(words, answer.message)

    def test_a_reset_brings_back_what_the_file_says(self):
        self.assertTrue(self.place(name="guest_1", absent=True).success)
        self.assertTrue(self.place(name="dora", kind="person", x=3.0, y=3.0).success)
        self.wait(lambda: self.person("guest_1").state == SimPerson.ABSENT and "dora" in self.people)
        self.assertTrue(self.call["reset"]().success)
        self.wait(lambda: self.person("guest_1").state == SimPerson.STANDING and "dora" not in self.people)
