#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A bridge answers every dispatch exactly once, and leaves the knowledge true, whatever its machine does."""

import copy
import os
import signal
import subprocess
import threading
import unittest
from unittest import mock

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from merlin_msgs.msg import DispatchStatus
from move_base_msgs.msg import MoveBaseActionResult
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from sound_play.msg import SoundRequestActionGoal

import rostest
from merlin_actions import action_interface
from merlin_actions.merlin_action import MerlinAction
from merlin_ros.publishing import publish
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.announced_interfaces import wait_for_interfaces
from merlin_test.held_drives import HeldDrives
from merlin_test.node_path import node_path
from merlin_test.topic_links import init_node, wait_for_publisher, wait_for_publishers

ALWAYS = rospy.Time()
DISPATCHER = "planning_system: rosplan_plan_dispatcher"
ACTIONS = "[merlin_actions.actions.navigate:Navigate, merlin_home.actions.ask:Ask]"
WHILE_RUNNING = "actions/navigate/while_running"
FINAL = (ActionFeedback.ACTION_FAILED, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE)


class LateBridge(MerlinAction):
    """A bridge that reads a dispatch which was latched before, however late, behind a status."""

    def start(self):
        subscriber = rospy.Subscriber
        read = {DispatchStatus: threading.Event(), ActionDispatch: threading.Event()}
        self.received = read[ActionDispatch]

        def subscribe(name, kind, callback, **options):
            def receive(message):
                assert kind is DispatchStatus or read[DispatchStatus].wait(LONG)
                callback(message)
                read[kind].set()

            return subscriber(name, kind, receive if kind in read else callback, **options)

        with mock.patch.object(rospy, "Subscriber", subscribe):
            super().start()


class Bridges(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.knowledge = MerlinROSPlanAssistant()
        cls.dispatches = rospy.Publisher("test_dispatch", ActionDispatch, latch=True, queue_size=10)
        cls.answers = []
        cls.changed = threading.Condition()
        cls.feedback = rospy.Subscriber("test_feedback", ActionFeedback, cls.receive)
        cls.drives = HeldDrives()
        cls.base_results = []
        results = rospy.Subscriber("move_base/result", MoveBaseActionResult, cls.receive_result)
        cls.asked, cls.speech = threading.Event(), threading.Event()
        cls.sentence = ""
        cls.sentences = rospy.Subscriber("sound_play/goal", SoundRequestActionGoal, cls.receive_sentence)
        rospy.Subscriber("sound_play/status", GoalStatusArray, cls.receive_speech)
        wait_for_publishers(results)
        cls.health = {}
        rospy.Subscriber("/diagnostics", DiagnosticArray, cls.receive_health)
        cls.number = 0
        cls.machines = None  # the process of the state machines, for the tests that leave them as they were
        wait_for_interfaces("navigate", "ask")
        wait_for_publishers(cls.feedback)

    @classmethod
    def tearDownClass(cls):
        cls.kill()

    def connected(self):
        return self.dispatches.get_num_connections()

    @classmethod
    def receive(cls, message):
        with cls.changed:
            cls.answers.append(message)
            cls.changed.notify_all()

    @classmethod
    def receive_sentence(cls, message):
        cls.sentence = message.goal_id.id
        cls.asked.set()

    @classmethod
    def receive_speech(cls, message):
        """The server speaks: a cancel before that ends the sentence unspoken."""
        running = [s.goal_id.id for s in message.status_list if s.status == GoalStatus.ACTIVE]
        if cls.sentence in running:
            cls.speech.set()

    @classmethod
    def receive_health(cls, message):
        with cls.changed:
            stamp = message.header.stamp
            cls.health.update({status.name: (stamp, status) for status in message.status})
            cls.changed.notify_all()

    @classmethod
    def receive_result(cls, message):
        with cls.changed:
            cls.base_results.append(message.status)
            cls.changed.notify_all()

    def wait_for_health(self, name, level, since=ALWAYS):
        with self.changed:

            def fits():
                stamp, status = self.health.get(name, (None, None))
                return status is not None and stamp >= since and status.level == level

            self.assertTrue(self.changed.wait_for(fits, LONG), f"{name}: {self.health.get(name)}")
            return self.health[name][1].message

    def setUp(self):
        self.wait_for_connections()
        self.addCleanup(self.drives.end)
        self.put_robot_into_kitchen()

    def hush(self):
        """Forgets what was spoken before, and waits until it is heard what the machines want to be spoken."""
        wait_for_publisher(self.sentences, "/merlin_fsm_host")
        type(self).sentence = ""
        self.asked.clear()
        self.speech.clear()

    def wait_for_connections(self):
        while not self.connected():
            rospy.rostime.wallsleep(0.02)

    @staticmethod
    def start(node, *arguments):
        command = [node_path("merlin_actions", node), f"_actions:={ACTIONS}", *arguments]
        return subprocess.Popen(command, start_new_session=True)

    def serve(self):
        """Has machines in another process; where they start, the bridge waits for them."""
        if self.machines is None:
            type(self).machines = self.start("fsm_host")
            self.assertEqual(self.final(self.go()).status, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE)
            self.put_robot_into_kitchen()

    def serve_alone(self):
        """Likewise for a test that leaves them in no state for another one."""
        self.serve()
        self.addCleanup(self.without_machines)

    def without_machines(self):
        """No machines, as the bridges see it, too."""
        self.kill()
        self.wait_for_health("merlin_bridges: navigate", DiagnosticStatus.ERROR, rospy.Time.now())

    def put_robot_into_kitchen(self):
        self.knowledge.change_facts(remove=self.knowledge.facts("robot_at"), add="(robot_at kitchen)")

    @classmethod
    def kill(cls):
        if cls.machines is not None:
            if cls.machines.poll() is None:
                os.killpg(cls.machines.pid, signal.SIGKILL)
            cls.machines.wait()
            cls.machines = None

    def end_machines(self, process):
        """Ends a node of machines by a signal while the robot drives, and waits until both have ended."""
        os.killpg(process.pid, signal.SIGINT)
        self.assertEqual(process.wait(LONG), 0)
        # A base whose goal is only forgotten drives on.
        with self.changed:

            def last_drive():
                return [status for status in self.base_results if status.goal_id.stamp >= self.begun]

            self.assertTrue(self.changed.wait_for(last_drive, LONG), self.base_results[-3:])
            self.assertEqual([status.status for status in last_drive()], [GoalStatus.PREEMPTED])

    def dispatch(self, name, number=None, **parameters):
        if number is None:
            Bridges.number += 1
            number = Bridges.number
        message = ActionDispatch(
            action_id=number,
            plan_id=7,
            name=name,
            parameters=[KeyValue(key, value) for key, value in parameters.items()],
        )
        self.dispatches.publish(message)
        return message

    def cancel(self, dispatch, **changes):
        message = copy.deepcopy(dispatch)
        message.name = "cancel_action"
        for key, value in changes.items():
            setattr(message, key, value)
        self.dispatches.publish(message)

    def answers_to(self, dispatch):
        return [
            answer
            for answer in self.answers
            if (answer.action_id, answer.plan_id) == (dispatch.action_id, dispatch.plan_id)
        ]

    def final(self, dispatch):
        with self.changed:

            def answered():
                return [answer for answer in self.answers_to(dispatch) if answer.status in FINAL]

            self.assertTrue(self.changed.wait_for(answered, LONG), f"no answer to {dispatch}")
            return answered()[0]

    def reason(self, answer):
        self.assertEqual(answer.status, ActionFeedback.ACTION_FAILED)
        return {entry.key: entry.value for entry in answer.information}["reason"]

    def robot_at(self):
        return self.knowledge.facts("robot_at")

    def go(self, **parameters):
        return self.dispatch("navigate", **{"from": "kitchen", "to": "bathroom", **parameters})

    def drive(self):
        """Has the robot drive until it is cancelled, or `drives` ends it; returns when it does."""
        self.begun = rospy.Time.now()
        self.drives.hold()
        dispatch = self.go()
        self.drives.wait_driving()
        return dispatch

    def wait_received(self):
        """Waits until the bridges have received what was dispatched before."""
        self.final(self.dispatch("ask"))  # without its parameter, it is answered at once

    def test_no_action_server(self):
        self.without_machines()
        self.bridge("navigate", server_wait=0.1)
        reason = self.reason(self.final(self.go()))
        self.assertIn("no action server", reason)
        self.assertIn("actions/navigate", reason)
        self.assertEqual(self.robot_at(), ["(robot_at kitchen)"])

    def test_diagnostics_tell_which_machine_is_missing(self):
        self.without_machines()
        self.assertEqual(self.wait_for_health(DISPATCHER, DiagnosticStatus.OK), "idle")
        reason = self.wait_for_health("merlin_bridges: navigate", DiagnosticStatus.ERROR)
        self.assertIn("no action server /actions/navigate", reason)
        self.serve()
        self.wait_for_health("merlin_bridges: navigate", DiagnosticStatus.OK)
        self.wait_for_health("merlin_fsm_host: ask", DiagnosticStatus.OK)
        self.without_machines()

    def test_a_missing_parameter(self):
        self.assertIn("?to", self.reason(self.final(self.dispatch("navigate", **{"from": "kitchen"}))))
        self.assertEqual(self.robot_at(), ["(robot_at kitchen)"])

    def test_success_applies_the_effects(self):
        self.serve()
        dispatch = self.go()
        self.assertEqual(self.final(dispatch).status, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE)
        self.assertEqual(self.robot_at(), ["(robot_at bathroom)"])

    def test_a_cancel_reaches_the_machine_and_the_robot_is_anywhere(self):
        self.serve()
        dispatch = self.drive()
        self.cancel(dispatch, action_id=9999)
        self.cancel(dispatch, parameters=[])
        self.cancel(dispatch)
        self.assertEqual(self.reason(self.final(dispatch)), "cancelled")
        self.assertEqual(self.robot_at(), ["(robot_at anywhere)"])
        self.drives.wait_stopped()

    def declare(self, *facts):
        """What is said to hold while a drive runs."""
        declared = rospy.get_param(WHILE_RUNNING, [])
        self.addCleanup(rospy.set_param, WHILE_RUNNING, declared)
        rospy.set_param(WHILE_RUNNING, list(facts))

    def test_what_is_declared_holds_while_it_runs_and_no_longer(self):
        self.serve()
        self.declare("(checked ?to)")
        for end in (lambda dispatch: self.drives.end(), self.cancel):
            dispatch = self.drive()
            self.assertTrue(self.knowledge.holds("(checked bathroom)"))
            end(dispatch)
            self.final(dispatch)
            self.assertFalse(self.knowledge.holds("(checked bathroom)"))
            self.put_robot_into_kitchen()

    def test_a_declaration_that_cannot_be_applied_fails_the_action_and_leaves_the_knowledge_true(self):
        self.serve()
        self.declare("(flying ?to)")
        self.assertIn("while it runs", self.reason(self.final(self.go())))
        self.assertEqual(self.robot_at(), ["(robot_at kitchen)"])

    def test_what_an_earlier_machine_has_declared_does_not_count(self):
        self.without_machines()
        self.declare("(flying ?to)")
        self.serve()

    def test_a_cancel_for_another_action_is_ignored(self):
        self.serve()
        dispatch = self.drive()
        self.cancel(dispatch, action_id=9999)
        self.cancel(dispatch, parameters=[KeyValue("from", "elsewhere")])
        self.wait_received()
        self.drives.end()
        self.assertEqual(self.final(dispatch).status, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE)

    def test_a_second_dispatch_waits_for_the_end_of_the_first(self):
        self.serve()
        first = self.drive()
        second = self.go()
        self.wait_received()
        self.drives.end()
        self.assertEqual(self.final(second).status, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE)
        self.assertEqual(self.final(first).status, ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE)
        ends = [answer.action_id for answer in self.answers if answer.status in FINAL][-2:]
        self.assertEqual(ends, [first.action_id, second.action_id])

    def test_a_killed_machine_is_reported(self):
        self.serve_alone()
        dispatch = self.drive()
        self.kill()
        self.assertIn("gone", self.reason(self.final(dispatch)))
        self.assertEqual(self.robot_at(), ["(robot_at anywhere)"])

    def test_a_node_of_machines_that_is_told_to_end_stops_the_robot_first(self):
        self.serve_alone()
        dispatch = self.drive()
        self.end_machines(self.machines)
        self.reason(self.final(dispatch))
        self.assertEqual(self.robot_at(), ["(robot_at anywhere)"])

    def test_a_node_of_naive_actions_that_is_told_to_end_stops_the_robot_first(self):
        # Topics of its own: the bridges would answer too.
        self.dispatches = rospy.Publisher("naive_dispatch", ActionDispatch, queue_size=10)
        self.addCleanup(self.dispatches.unregister)
        actions = self.start("naive_actions", "rosplan_plan_dispatcher/action_dispatch:=naive_dispatch")
        self.addCleanup(lambda: actions.poll() is None and os.killpg(actions.pid, signal.SIGKILL))
        self.wait_for_connections()
        self.drive()
        self.end_machines(actions)
        self.assertEqual(self.robot_at(), ["(robot_at anywhere)"])

    def test_a_machine_that_does_not_stop_is_named(self):
        self.serve_alone()
        self.hush()
        dispatch = self.dispatch("ask", p="kitchen")
        self.assertTrue(self.speech.wait(LONG))
        self.cancel(dispatch)
        answer = self.final(dispatch)
        self.assertIn("sound_play did not stop", self.reason(answer))
        self.assertIn(KeyValue("stopped", "no"), answer.information)
        self.assertFalse(self.knowledge.holds("(checked kitchen)"))

    def bridge(self, operator, **options):
        """A bridge of this process, with dispatches of its own."""
        bridge = MerlinAction(
            operator, dispatch_topic="own_dispatch", feedback_topic="test_feedback", **options
        )
        self.dispatches = rospy.Publisher("own_dispatch", ActionDispatch, queue_size=10)
        self.addCleanup(self.dispatches.unregister)
        bridge.start()
        self.addCleanup(bridge.shutdown)
        self.wait_for_connections()

    def test_without_a_cancel_limit_a_machine_may_take_its_time(self):
        self.serve_alone()
        self.bridge("ask", cancel_limit=0.0)
        self.hush()
        dispatch = self.dispatch("ask", p="kitchen")
        self.assertTrue(self.asked.wait(LONG))
        self.cancel(dispatch)
        self.assertNotIn("does not stop (", self.reason(self.final(dispatch)))

    def test_a_cancel_ends_the_wait_for_a_machine(self):
        self.without_machines()
        self.bridge("navigate", server_wait=10 * LONG)
        dispatch = self.go()
        with self.changed:
            self.assertTrue(self.changed.wait_for(lambda: self.answers_to(dispatch), LONG))
        self.cancel(dispatch)
        self.assertEqual(self.reason(self.final(dispatch)), "cancelled")
        self.assertEqual(self.robot_at(), ["(robot_at kitchen)"])

    def test_a_late_bridge_does_not_run_an_old_dispatch(self):
        old = self.dispatch("ask")  # without its parameter, it is answered at once
        self.final(old)
        count = len(self.answers_to(old))
        status = rospy.Publisher("dispatch_status", DispatchStatus, latch=True, queue_size=1)
        self.addCleanup(status.unregister)
        status.publish(DispatchStatus())  # as dispatchers do: nothing runs
        late = LateBridge("ask", dispatch_topic="test_dispatch", feedback_topic="test_feedback")
        answers = []

        def note(publisher, message):
            if isinstance(message, ActionFeedback):
                answers.append(message)
            publish(publisher, message)

        with mock.patch.object(action_interface, "publish", note):
            late.start()
            self.addCleanup(late.shutdown)
            self.assertTrue(late.received.wait(LONG))
            self.assertEqual((answers, late.executions()), ([], []))
        self.assertEqual(len(self.answers_to(old)), count)


if __name__ == "__main__":
    init_node("bridges_test")
    rostest.rosrun("merlin_test", "bridges", Bridges)
