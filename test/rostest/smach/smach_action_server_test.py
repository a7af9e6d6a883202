# SPDX-License-Identifier: Apache-2.0
"""Containers offered as actions: P13, U6, D11."""

import os
import signal
import subprocess
import threading
import time
import unittest
from unittest import mock

import actionlib
import rospy
from actionlib.msg import TestAction, TestFeedback, TestGoal, TestResult
from actionlib_msgs.msg import GoalStatus
from smach_fixture import Calling, Done, machine

import smach
from merlin_test import LONG
from merlin_test.node_path import lean_script
from merlin_test.topic_links import wait_for_connections
from smach_ros import ActionServerWrapper


class Server(actionlib.ActionServer):
    """That of a wrapped container; the one made last."""

    made = None

    def __init__(self, *args, **how):
        super().__init__(*args, **how)
        Server.made = self


class Client(actionlib.SimpleActionClient):
    """actionlib's own one waits for ever for a goal that ends before its `send_goal` has returned."""

    def __init__(self, *args):
        self.sending = threading.Lock()
        super().__init__(*args)

    def send_goal(self, *args, **callbacks):
        with self.sending:
            super().send_goal(*args, **callbacks)

    def _handle_transition(self, handle):
        with self.sending:
            super()._handle_transition(handle)


def until_linked(server, clients=1):
    """Waits until a server sends to its clients: they hear of a connection before it does."""
    wait_for_connections(server.status_pub, server.result_pub, server.feedback_pub, count=clients)


def until_active(client):
    """Waits until a client knows that its goal runs.

    actionlib takes one that is cancelled earlier for lost when a status of before comes late.
    """
    end = time.monotonic() + LONG
    while client.get_state() != GoalStatus.ACTIVE:
        assert time.monotonic() < end, client.get_state()
        rospy.rostime.wallsleep(0.01)


class Wrapper(unittest.TestCase):
    number = 0

    def wrap(self, state, **how):
        Wrapper.number += 1
        name = f"wrapped{Wrapper.number}"
        container = machine(
            state,
            input_keys=["action_goal", "goal", "number"],
            output_keys=["action_result", "result", "answer"],
            outcomes=["done", "preempted", "failed"],
        )
        client, wrapper = self.serve(name, container, ["done"], ["failed"], ["preempted"], **how)
        return client, container, wrapper

    def serve(self, name, container, *outcomes, **how):
        with mock.patch.object(actionlib, "ActionServer", Server):
            wrapper = ActionServerWrapper(name, TestAction, container, *outcomes, **how)
        wrapper.run_server()
        self.addCleanup(Server.made.stop)
        client = Client(name, TestAction)
        self.assertTrue(client.wait_for_server(rospy.Duration(LONG)))
        until_linked(Server.made)
        return client, wrapper

    def run_goal(self, client, goal=0):
        client.send_goal(TestGoal(goal=goal))
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
        return client.get_state(), client.get_result().result

    def test_goal_result_and_outcomes(self):
        def work(state, ud):
            if ud.action_goal.goal == 2:
                return "failed"
            if ud.action_goal.goal == 3:
                raise ValueError("broken")
            ud.action_result = TestResult(result=ud.action_goal.goal + 10)
            return "done"

        keys = {"input_keys": ["action_goal"], "output_keys": ["action_result"]}
        client, _, _ = self.wrap(Calling(work, ["done", "failed", "preempted"], **keys))
        self.assertEqual(self.run_goal(client, 1), (GoalStatus.SUCCEEDED, 11))
        self.assertEqual(
            self.run_goal(client, 2), (GoalStatus.ABORTED, 0), "U6: not the result of the goal before"
        )
        self.assertEqual(self.run_goal(client, 3), (GoalStatus.ABORTED, 0))
        self.assertRegex(client.get_goal_status_text(), r"\A[^\n]*ValueError: broken\Z")
        self.assertEqual(self.run_goal(client, 4), (GoalStatus.SUCCEEDED, 14))

    def test_states_fill_in_the_empty_result_and_feedback(self):
        seen = []

        def work(state, ud):
            seen.append((ud.action_result.result, ud.action_feedback.feedback))
            ud.action_result.result = ud.action_goal.goal + 10
            ud.action_feedback.feedback = 3
            return "done"

        keys = ["action_result", "action_feedback"]
        state = Calling(work, input_keys=["action_goal", *keys], output_keys=keys)
        client, container, wrapper = self.wrap(state)
        container.register_input_keys(keys)
        for key, message in zip(["action_goal", *keys], (TestGoal, TestResult, TestFeedback)):
            self.assertEqual(wrapper.userdata[key], message())
        self.assertEqual(self.run_goal(client, 1), (GoalStatus.SUCCEEDED, 11))
        self.assertEqual(self.run_goal(client, 2), (GoalStatus.SUCCEEDED, 12))
        self.assertEqual(seen, [(0, 0), (0, 0)], "a goal sees what the one before filled in")

    def test_slots(self):
        def work(state, ud):
            ud.answer = ud.goal + ud.number
            return "done"

        keys = {"input_keys": ["goal", "number"], "output_keys": ["answer"]}
        client, _, wrapper = self.wrap(
            Calling(work, **keys),
            expand_goal_slots=True,
            goal_slots_map={"goal": "number"},
            result_slots_map={"result": "answer"},
        )
        wrapper.userdata.preset = 1
        self.assertEqual(self.run_goal(client, 4), (GoalStatus.SUCCEEDED, 8))
        self.assertEqual(wrapper.userdata.preset, 1)

    def test_pack_result_slots(self):
        def work(state, ud):
            ud.result = 6
            return "done"

        client, _, _ = self.wrap(Calling(work, output_keys=["result"]), pack_result_slots=True)
        self.assertEqual(self.run_goal(client), (GoalStatus.SUCCEEDED, 6))

    def test_d11_feedback_slots_map_and_feedback_key(self):
        name = f"feedback{Wrapper.number}"
        # A client drops feedback that comes before send_goal() has returned.
        sent = threading.Event()

        def telling(key, value):
            def tell(state, ud):
                assert sent.wait(LONG)
                ud[key] = value
                return "done"

            return Calling(tell, ["done"], output_keys=[key])

        progress, whole = telling("progress", 5), telling("action_feedback", TestFeedback(feedback=6))
        for state, how, expected in (
            (progress, {"feedback_slots_map": {"feedback": "progress"}}, 5),
            (whole, {}, 6),
        ):
            seen, came = [], threading.Event()
            # Feedback travels beside the result; a client drops what comes behind it.
            last = Calling(lambda state, ud, c=came: "done" if c.wait(LONG) else "late", ["done"])
            container = machine(state, last, outcomes=["done"])
            client, _ = self.serve(f"{name}_{expected}", container, ["done"], **how)
            sent.clear()
            client.send_goal(
                TestGoal(), feedback_cb=lambda m, s=seen, c=came: s.append(m.feedback) or c.set()
            )
            sent.set()
            self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
            self.assertEqual(seen, [expected])

    def waiting(self):
        class Waiting(smach.State):
            def __init__(self):
                smach.State.__init__(self, ["done", "preempted"], input_keys=["action_goal"])
                self.started, self.asked = threading.Semaphore(0), threading.Event()

            def request_preempt(self):
                smach.State.request_preempt(self)
                self.asked.set()

            def execute(self, ud):
                if ud.action_goal.goal == 0:
                    return "done"
                self.asked.clear()
                self.started.release()
                if not self.preempt_requested():
                    assert self.asked.wait(LONG)
                self.service_preempt()
                return "preempted"

        return Waiting()

    def test_cancel_and_newer_goal_preempt(self):
        state = self.waiting()
        client, _, _ = self.wrap(state)
        client.send_goal(TestGoal(goal=1))
        self.assertTrue(state.started.acquire(timeout=LONG))
        until_active(client)
        client.cancel_goal()
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
        self.assertEqual(client.get_state(), GoalStatus.PREEMPTED)
        raw = actionlib.ActionClient(client.action_client.ns, TestAction)
        self.assertTrue(raw.wait_for_server(rospy.Duration(LONG)))
        ended = threading.Semaphore(0)

        def moved(goal):
            if goal.get_comm_state() == actionlib.CommState.DONE:
                ended.release()

        first = raw.send_goal(TestGoal(goal=1), moved)
        self.assertTrue(state.started.acquire(timeout=LONG))
        second = raw.send_goal(TestGoal(goal=0), moved)
        for _ in range(2):
            self.assertTrue(ended.acquire(timeout=LONG))
        self.assertEqual(first.get_terminal_state(), GoalStatus.PREEMPTED)
        self.assertEqual(second.get_terminal_state(), GoalStatus.SUCCEEDED)

    def test_p13_cancel_that_comes_as_the_container_ends_is_not_for_the_next_goal(self):
        state = self.waiting()
        client, container, _ = self.wrap(state)
        ends, cancelled = threading.Event(), threading.Event()
        receive = Server.made.cancel_callback

        def receive_cancel(goal):
            receive(goal)
            cancelled.set()

        Server.made.register_cancel_callback(receive_cancel)

        def terminated(*args):
            ends.set()
            assert cancelled.wait(LONG)

        container.register_termination_cb(terminated)
        client.send_goal(TestGoal(goal=0))
        self.assertTrue(ends.wait(LONG))
        until_active(client)
        client.cancel_goal()
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
        self.assertEqual(client.get_state(), GoalStatus.SUCCEEDED)
        self.assertEqual(self.run_goal(client, 0)[0], GoalStatus.SUCCEEDED)
        client.send_goal(TestGoal(goal=1))
        self.assertTrue(state.started.acquire(timeout=LONG))
        self.assertTrue(container.is_running(), "preempted by a cancel of another goal")
        client.cancel_goal()
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))

    def test_the_goal_of_a_program_that_is_interrupted_is_preempted_and_answered(self):
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "smach_victim.py")
        process = subprocess.Popen(lean_script(script, "wrapper"), stdout=subprocess.PIPE, text=True)
        self.addCleanup(process.wait)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.kill)
        client = Client("victim", TestAction)
        self.assertTrue(client.wait_for_server(rospy.Duration(LONG)))
        client.send_goal(TestGoal())
        self.assertEqual(process.stdout.readline(), "running\n")
        process.send_signal(signal.SIGINT)
        self.assertTrue(client.wait_for_result(rospy.Duration(LONG)))
        self.assertEqual(client.get_state(), GoalStatus.PREEMPTED)

    def test_broken_definitions_raise(self):
        container = machine(Done())
        for how in (
            {"succeeded_outcomes": ["unheard"]},
            {"succeeded_outcomes": ["done"], "aborted_outcomes": ["done"]},
        ):
            with self.assertRaises(smach.InvalidStateError):
                ActionServerWrapper("never", TestAction, container, **how)
        with self.assertRaises(smach.InvalidConstructionError):
            ActionServerWrapper("never", TestAction, container, ["done"], goal_slots_map={"speed": "x"})
