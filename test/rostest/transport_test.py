#!/usr/bin/env python3
"""merlin_sm's transport over real connections: actions, services, and servers that die."""

import os
import signal
import subprocess
import sys
import threading
import unittest
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import SimStatus
from rosplan_dispatch_msgs.msg import NonBlockingDispatchAction as Action
from rosplan_dispatch_msgs.msg import NonBlockingDispatchGoal as Goal
from rosplan_dispatch_msgs.msg import NonBlockingDispatchResult as Result
from std_srvs.srv import Trigger, TriggerResponse

import rostest
from merlin_sm import deadline
from merlin_sm.action_client import SILENCE, ActionClient
from merlin_sm.action_server import ActionServer
from merlin_sm.serial_action_server import SerialActionServer
from merlin_sm.service_proxy import ServiceError, ServiceProxy

LONG = 60.0


def start_victim() -> subprocess.Popen:
    return subprocess.Popen([sys.executable, str(Path(__file__).with_name("victim_server.py"))])


class Deadlines(unittest.TestCase):
    def test_a_deadline_begins_where_the_simulator_was_heard_before(self):
        received = threading.Event()
        publisher = rospy.Publisher(deadline.SIM_STATUS_TOPIC, SimStatus, latch=True, queue_size=1)
        self.addCleanup(publisher.unregister)
        publisher.publish(SimStatus())
        earlier = rospy.Subscriber(deadline.SIM_STATUS_TOPIC, SimStatus, lambda _: received.set())
        self.addCleanup(earlier.unregister)
        self.assertTrue(received.wait(LONG))
        watch = deadline._PauseWatch()  # that of the process has begun long ago
        read = threading.Thread(target=watch.paused_time, daemon=True)
        read.start()
        read.join(LONG)
        self.assertFalse(read.is_alive())


class Actions(unittest.TestCase):
    def serve(self, name, execute, on_cancel=None):
        server = SerialActionServer(name, Action, execute, on_cancel)
        server.start()
        self.addCleanup(server.shutdown)
        client = ActionClient(name, Action)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        return client

    def test_a_very_fast_result_is_not_missed(self):
        client = self.serve("fast", lambda goal: goal.succeed(Result(success=True), "done"))
        for _ in range(200):
            sent = client.send(Goal())
            self.assertTrue(sent.wait(LONG))
            self.assertEqual((sent.status, sent.text), (GoalStatus.SUCCEEDED, "done"))
            self.assertTrue(sent.result.success)

    def test_no_time_to_wait_is_one_look(self):
        client = ActionClient("never_there", Action)
        self.addCleanup(client.shutdown)
        self.assertFalse(client.wait_for_server(0.0))
        self.assertFalse(client.send(Goal()).wait(0.0))

    def test_a_cancel_in_the_same_instant_as_its_goal_is_not_lost(self):
        def execute(goal):
            goal.cancel_event.wait(LONG)
            goal.cancelled()

        client = self.serve("instant", execute)
        for _ in range(100):
            sent = client.send(Goal())
            sent.cancel()
            self.assertTrue(sent.wait(LONG))
            self.assertIn(sent.status, (GoalStatus.PREEMPTED, GoalStatus.RECALLED))

    def test_a_cancel_that_overtakes_its_goal_recalls_it(self):
        begun = []
        server = ActionServer("overtaken", Action, begun.append, lambda goal: None)
        server.start()
        self.addCleanup(server.shutdown)
        client = ActionClient("overtaken", Action)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        received = threading.Event()
        receive = server._receive_cancel
        early = rospy.Subscriber("overtaken/cancel", GoalID, lambda message: received.set())
        self.addCleanup(early.unregister)
        server._receive_cancel(GoalID(id="early"))
        self.assertIsNotNone(receive)
        goal = type(Action().action_goal)()
        goal.goal_id.id = "early"
        server._receive_goal(goal)
        self.assertEqual(begun, [])

    def test_a_newer_goal_preempts_the_older_at_once(self):
        stopped = []

        def execute(goal):
            if goal.cancel_event.wait(0.0 if stopped else LONG):
                goal.cancelled()
            else:
                goal.succeed()

        client = self.serve("newer", execute, stopped.append)
        first = client.send(Goal())
        while first.status != GoalStatus.ACTIVE:
            self.assertFalse(first.wait(0.01))
        second = client.send(Goal())
        self.assertTrue(first.wait(LONG) and second.wait(LONG))
        self.assertEqual((first.status, second.status), (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED))
        self.assertEqual(len(stopped), 1)

    def test_an_exception_in_the_server_ends_the_goal_aborted(self):
        def execute(goal):
            raise RuntimeError("broken on purpose")

        client = self.serve("broken", execute)
        sent = client.send(Goal())
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.ABORTED)
        self.assertIn("broken on purpose", sent.text)

    def wait_for_the_victim(self):
        """A client, and a goal that the victim works on."""
        client = ActionClient("victim/wait", Action)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        sent = client.send(Goal())
        while sent.status != GoalStatus.ACTIVE:
            self.assertFalse(sent.wait(0.01))
        return client, sent

    def test_a_killed_server_ends_its_goals_as_lost(self):
        victim = start_victim()
        _, sent = self.wait_for_the_victim()
        os.kill(victim.pid, signal.SIGKILL)
        victim.wait()
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.LOST)
        self.assertIn("silent", sent.text)

    def test_a_server_without_a_processor_for_a_while_is_not_given_up(self):
        victim = start_victim()
        self.addCleanup(victim.wait)
        self.addCleanup(victim.kill)
        client, sent = self.wait_for_the_victim()
        victim.send_signal(signal.SIGSTOP)
        self.assertFalse(sent.wait(SILENCE + 1.5), sent.text)
        self.assertTrue(client.alive)
        victim.send_signal(signal.SIGCONT)
        sent.cancel()
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.PREEMPTED)


class Services(unittest.TestCase):
    def test_a_restarted_server_is_found_again(self):
        ask = ServiceProxy("victim/ask", Trigger)
        for _ in range(2):
            victim = start_victim()
            try:
                self.assertTrue(ask.wait(LONG))
                self.assertEqual(ask().message, "/victim")
            finally:
                os.kill(victim.pid, signal.SIGKILL)
                victim.wait()
        with self.assertRaises(ServiceError) as caught:
            ask()
        self.assertIn("/victim/ask", str(caught.exception))

    def test_threads_share_a_proxy(self):
        service = rospy.Service("shared", Trigger, lambda request: TriggerResponse(True, "yes"))
        self.addCleanup(service.shutdown)
        proxy = ServiceProxy("shared", Trigger)
        answers = []
        threads = [
            threading.Thread(target=lambda: answers.extend(proxy().message for _ in range(50)))
            for _ in range(8)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(answers, ["yes"] * 400)

    def test_a_server_that_hangs_is_given_up(self):
        release = threading.Event()
        self.addCleanup(release.set)
        service = rospy.Service("hangs", Trigger, lambda request: release.wait() and TriggerResponse())
        self.addCleanup(service.shutdown)
        with self.assertRaises(ServiceError):
            ServiceProxy("hangs", Trigger, timeout=0.2)()

    def test_the_first_call_waits_for_a_server_that_is_being_started(self):
        offered = []
        ask = ServiceProxy("comes_late", Trigger, patience=LONG)
        look = ask.available

        def start_after_the_first_look():
            found = look()
            if not offered:
                offered.append(rospy.Service("comes_late", Trigger, lambda _: TriggerResponse(True, "here")))
            return found

        ask.available = start_after_the_first_look
        self.addCleanup(lambda: offered[0].shutdown())
        self.assertEqual(ask().message, "here")

    def test_a_refusal_is_told_in_the_words_of_the_server(self):
        def refuse(_):
            raise rospy.ServiceException("battery of 'anna' is \"flat\", naïve")

        service = rospy.Service("refuses", Trigger, refuse)
        self.addCleanup(service.shutdown)
        with self.assertRaises(ServiceError) as caught:
            ServiceProxy("refuses", Trigger)()
        self.assertEqual(
            str(caught.exception), "service /refuses failed: battery of 'anna' is \"flat\", naïve"
        )

    def test_a_missing_service_is_named(self):
        with self.assertRaises(ServiceError) as caught:
            ServiceProxy("nowhere", Trigger)()
        self.assertIn("/nowhere", str(caught.exception))


class Transport(Deadlines, Actions, Services):
    pass


if __name__ == "__main__":
    rospy.init_node("transport_test")
    rostest.rosrun("merlin_test", "transport", Transport)
