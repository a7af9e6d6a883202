# SPDX-License-Identifier: Apache-2.0
"""Many goals and results in one moment: none of them is lost on the way."""

import threading
import unittest
from unittest import mock

import rospy
from actionlib_msgs.msg import GoalStatus
from rosplan_dispatch_msgs.msg import NonBlockingDispatchAction as Action
from rosplan_dispatch_msgs.msg import NonBlockingDispatchGoal as Goal
from rosplan_dispatch_msgs.msg import NonBlockingDispatchResult as Result
from rospy.impl.registration import get_topic_manager

from merlin_ros.actions import server_silence
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.action_server import ActionServer
from merlin_test import LONG


class Floods(unittest.TestCase):
    """rospy queues what a connection does not take yet, and drops the oldest when the queue is full."""

    FLOOD = 300

    def flooded(self, name):
        """A client of a server that keeps its goals, and a wait for the goals of a flood."""
        received, changed = [], threading.Condition()

        def receive(goal):
            goal.accept()
            with changed:
                received.append(goal)
                changed.notify_all()

        def wait_received():
            with changed:
                self.assertTrue(changed.wait_for(lambda: len(received) == self.FLOOD, LONG))
            return received

        server = ActionServer(name, Action, receive, lambda goal: goal.cancelled())
        server.start()
        self.addCleanup(server.shutdown)
        client = ActionClient(name, Action)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        return client, wait_received

    def starve(self, topic):
        """Keeps the thread that writes to the connections of a topic from its work."""
        going_on = threading.Event()
        self.addCleanup(going_on.set)
        for connection in get_topic_manager().get_publisher_impl(rospy.resolve_name(topic)).connections:
            write = connection._connection.write_data
            connection._connection.write_data = lambda data, write=write: going_on.wait(LONG) and write(data)
        return going_on

    @mock.patch.object(server_silence, "SILENCE", LONG)  # none arrives while they are kept from their way
    def test_goals_that_are_sent_at_once_all_arrive(self):
        client, wait_received = self.flooded("many_goals")
        going_on = self.starve("many_goals/goal")
        for _ in range(self.FLOOD):
            client.send(Goal())
        going_on.set()
        wait_received()

    @mock.patch.object(server_silence, "LATE_RESULT", LONG)  # their ends are told while the results wait
    def test_results_that_are_sent_at_once_all_arrive(self):
        client, wait_received = self.flooded("many_results")
        sent = [client.send(Goal()) for _ in range(self.FLOOD)]
        received = wait_received()
        going_on = self.starve("many_results/result")
        for goal in received:
            goal.succeed(Result(success=True), "done")
        going_on.set()
        for goal in sent:
            self.assertTrue(goal.wait(LONG))
            self.assertEqual((goal.status, goal.text), (GoalStatus.SUCCEEDED, "done"))
