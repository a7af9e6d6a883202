# SPDX-License-Identifier: Apache-2.0
"""What the tests of a guard that runs have in common."""

import os
import signal
import unittest

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import Twist
from guard_fixture import Client, Witness
from sensor_msgs.msg import Joy
from std_msgs.msg import Empty, String
from std_srvs.srv import Empty as EmptyService
from std_srvs.srv import SetBool, Trigger

from merlin_test import LONG
from merlin_test.topic_links import pid_of

IDLE, PASSING, HOLDING, STOPPED = range(4)
LIVE = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)


class GuardCase(unittest.TestCase):
    """A guard between a base and clients of this process; each test begins without goals."""

    shared = []  # the client of tests that leave it as it was

    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.cancel = rospy.Publisher("move_base/cancel", GoalID, queue_size=10)
        cls.commands = rospy.Publisher("cmd_vel_in", Twist, queue_size=10)
        rospy.wait_for_service("move_base/stubborn", LONG)
        cls.stubborn = rospy.ServiceProxy("move_base/stubborn", SetBool)
        cls.stop_topic = rospy.Publisher("merlin/stop", Empty, queue_size=1)
        cls.stop_by = rospy.Publisher("merlin/stop_by", String, queue_size=1)
        cls.brake = rospy.Publisher("merlin/brake", String, queue_size=1)
        cls.joy = rospy.Publisher("joy", Joy, queue_size=1)
        cls.witness.wait(lambda: cls.witness.status is not None and cls.connected())

    @classmethod
    def tearDownClass(cls):
        cls.witness.close()
        cls.end_shared_client()

    @classmethod
    def connected(cls):
        links = [publisher.get_num_connections() for publisher in cls.publishers()]
        return all(links) and cls.cancel.get_num_connections() > 1

    @classmethod
    def publishers(cls):
        return cls.cancel, cls.commands, cls.stop_topic, cls.stop_by, cls.brake, cls.joy

    def setUp(self):
        self.call("merlin/release")
        self.addCleanup(self.end_goals)

    @property
    def client(self):
        """One that several tests use, and none kills or hangs."""
        if not self.shared:
            self.shared.append(Client("motion_client"))
        return self.shared[0]

    @classmethod
    def end_shared_client(cls):
        while cls.shared:
            cls.shared.pop().end()

    def start_client(self):
        """One of this test, that may be killed; the test's next one takes its place."""
        client = Client("victim")
        self.addCleanup(client.end)
        return client

    def end_goals(self):
        self.stubborn(False)
        rospy.ServiceProxy("move_base/end", EmptyService)()
        self.witness.wait(self.nothing_runs)
        for client in self.shared:
            client.ask("release")
        self.call("merlin/release")
        self.witness.state(IDLE)
        self.witness.wait(lambda: not (self.witness.velocities and self.witness.velocities[-1]))

    def nothing_runs(self):
        return not any(status in LIVE for status in self.witness.goals.values())

    def call(self, service):
        rospy.wait_for_service(service, LONG)
        return rospy.ServiceProxy(service, Trigger)()

    def guard_links(self):
        """What this node's publishers send to the guard through, by topic."""
        return {
            publisher.name: [
                link for link in publisher.impl.connections if link.endpoint_id == "/merlin_guard"
            ]
            for publisher in self.publishers()
        }

    def kill_guard(self):
        """Kills the guard; returns what waits until another one hears this node."""
        old = self.guard_links()
        self.addCleanup(self.end_shared_client)  # it may still have the link to this guard
        os.kill(pid_of("/merlin_guard"), signal.SIGKILL)

        def is_new(topic, links):
            return any(all(link is not known for known in old[topic]) for link in links)

        def is_back():
            return all(is_new(topic, links) for topic, links in self.guard_links().items())

        return lambda: self.witness.wait(is_back)

    def drive(self, client=None):
        client = client or self.client
        goal = client.ask("drive suspended")
        self.witness.wait(lambda: goal in self.witness.status.goals)
        self.witness.state(HOLDING, "says that its own owner is silent")  # the guard has heard its lease
        client.ask("resume")
        self.witness.forget()
        self.witness.wait(lambda: any(self.witness.velocities))
        self.witness.wait(lambda: (self.witness.status.state, self.witness.status.goals) == (PASSING, [goal]))
        return goal

    def zero(self):
        """Waits until the last velocity is zero."""
        self.witness.wait(lambda: self.witness.velocities and not self.witness.velocities[-1])

    def stands(self):
        """Waits for the zero velocity, and for some commands more, none of which may pass."""
        self.witness.still()
        self.witness.forget()
        self.witness.wait(lambda: len(self.witness.velocities) > 5)
        self.assertNotIn(True, self.witness.velocities)

    def ended(self, goal):
        # A cancel may come before the base has begun with its goal.
        ends = (GoalStatus.PREEMPTED, GoalStatus.RECALLED)
        self.witness.wait(lambda: self.witness.goals.get(goal) in ends)
