# SPDX-License-Identifier: Apache-2.0
"""SimpleActionState: P9, P10, B1 to B5 and U7, against servers of every temper."""

import os
import signal
import subprocess
import sys
import threading
import time
import unittest
from unittest import mock

import actionlib
import rosgraph
import rospy
from actionlib.msg import TestAction, TestGoal, TestResult
from actionlib_msgs.msg import GoalID, GoalStatus
from rospy.impl import registration
from smach_fixture import Run

import smach
from merlin_test import LONG
from merlin_test.node_path import LEAN, lean_script
from merlin_test.topic_links import wait_for_publisher
from smach_ros import SimpleActionState, action_connection

SUCCEED, OBEY, ANSWER_SUCCEEDED, ANSWER_ABORTED, ANSWER_RECALLED, IGNORE, ABORT = range(7)
HERE = os.path.dirname(os.path.abspath(__file__))


class Server:
    """An action server that treats each goal as the goal's number says."""

    def __init__(self, name):
        self.goals, self.cancels = [], []
        self.changed = threading.Condition()
        self.server = actionlib.ActionServer(name, TestAction, self.on_goal, self.on_cancel, auto_start=False)
        self.server.start()

    def on_goal(self, goal):
        mode = goal.get_goal().goal
        if mode != ANSWER_RECALLED:
            goal.set_accepted()
        with self.changed:
            self.goals.append(goal)
            self.changed.notify_all()
        if mode == SUCCEED:
            goal.set_succeeded(TestResult(result=7))
        elif mode == ABORT:
            goal.set_aborted(text="the hose has burst")

    def on_cancel(self, goal):
        with self.changed:
            self.cancels.append(goal)
            self.changed.notify_all()
        mode = goal.get_goal().goal
        if mode in (OBEY, ANSWER_RECALLED):
            goal.set_canceled()
        elif mode == ANSWER_SUCCEEDED:
            goal.set_succeeded(TestResult(result=8))
        elif mode == ANSWER_ABORTED:
            goal.set_aborted()

    def wait_for_goals(self, count):
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.goals) >= count, LONG)


class ActionStates(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.server = Server("tempers")

    def setUp(self):
        # What a test before has sent and not waited for arrives before this one.
        self.assertEqual(Run(self.action(SUCCEED)).end(), "succeeded")
        self.before = len(self.server.goals)

    def action(self, mode=None, **how):
        how.setdefault("goal", None if mode is None else TestGoal(goal=mode))
        return SimpleActionState("tempers", TestAction, **how)

    def interrupted(self, state, **userdata):
        """Executes a state and preempts it when its goal has arrived."""
        arrived = len(self.server.goals)
        run = Run(state, **userdata)
        self.server.wait_for_goals(arrived + 1)
        state.request_preempt()
        return run.end()

    def test_outcomes_goal_and_result(self):
        state = self.action(goal_slots=["goal"], result_key="whole", result_slots=["result"])
        run = Run(state, goal=SUCCEED)
        self.assertEqual(run.end(), "succeeded")
        self.assertEqual((run.ud.result, run.ud.whole), (7, TestResult(result=7)))
        self.assertEqual(Run(state, goal=ABORT).end(), "aborted")
        self.assertEqual(state.reason, "Action tempers: the goal ended with status 4: the hose has burst")
        self.assertEqual(Run(state).end(), "aborted")  # no key, no goal
        self.assertEqual(self.interrupted(self.action(OBEY)), "preempted")

    def test_goal_key_and_callbacks(self):
        @smach.cb_interface(input_keys=["mode"], output_keys=["seen"], outcomes=["special"])
        def result_cb(ud, status, result, *args, **kwargs):
            ud.seen = (status, result.result, args, kwargs, ud.mode)
            return "special"

        def goal_cb(ud, goal, addend):
            goal.goal += addend

        state = self.action(
            goal_key="g",
            goal_cb=goal_cb,
            goal_cb_kwargs={"addend": SUCCEED - OBEY},
            result_cb=result_cb,
            result_cb_args=[1],
            result_cb_kwargs={"k": 2},
        )
        run = Run(state, g=TestGoal(goal=OBEY), mode="m")
        self.assertEqual(run.end(), "special")
        # D11: arguments of the result callback were accepted and had no effect.
        self.assertEqual(run.ud.seen, (GoalStatus.SUCCEEDED, 7, (1,), {"k": 2}, "m"))
        self.assertIn("mode", state.get_registered_input_keys())

    def test_p9_flag_is_gone_whatever_the_server_answers_to_a_cancel(self):
        for mode, expected in (
            (ANSWER_SUCCEEDED, "succeeded"),
            (ANSWER_ABORTED, "aborted"),
            (ANSWER_RECALLED, "preempted"),
        ):
            state = self.action(goal_slots=["goal"])
            self.assertEqual(self.interrupted(state, goal=mode), expected)
            self.assertFalse(state.preempt_requested())
            self.assertEqual(Run(state, goal=SUCCEED).end(), "succeeded")

    def test_p9_request_that_the_server_overtook_goes_on_to_the_next_state(self):
        first, second = self.action(ANSWER_SUCCEEDED), self.action(OBEY)
        sm = smach.StateMachine(["succeeded", "aborted", "preempted"])
        with sm:
            smach.StateMachine.add("FIRST", first, {"succeeded": "SECOND"})
            smach.StateMachine.add("SECOND", second)
        run = Run(sm)
        self.server.wait_for_goals(self.before + 1)
        sm.request_preempt()
        self.assertEqual(run.end(), "preempted")
        self.assertEqual(len(self.server.goals), self.before + 1)

    def test_p10_request_while_the_goal_is_made_keeps_it_from_being_sent(self):
        state = self.action(OBEY, goal_cb=lambda ud, goal: state.request_preempt())
        self.assertEqual(Run(state).end(), "preempted")
        self.assertEqual(Run(self.action(SUCCEED)).end(), "succeeded")  # all that was sent has arrived now
        self.assertEqual(len(self.server.goals), self.before + 1)

    def test_b1_server_that_ignores_a_cancel_is_left_after_preempt_timeout(self):
        state = self.action(IGNORE, preempt_timeout=rospy.Duration(0.3))
        self.assertEqual(self.interrupted(state), "preempted")
        state = self.action(IGNORE, preempt_timeout=0.3, exec_timeout=rospy.Duration(0.1))
        self.assertEqual(Run(state).end(), "aborted")

    def test_b2_server_that_dies_ends_the_state(self):
        victim = self.victim()
        state = SimpleActionState("victim", TestAction, goal=TestGoal(goal=OBEY))
        run, sent = Run(state), threading.Event()
        rospy.Subscriber("victim/feedback", rospy.AnyMsg, lambda message: sent.set())
        self.assertTrue(sent.wait(LONG))
        victim.kill()
        self.assertEqual(run.end(), "aborted")
        # B5: and a server that comes later is found.
        self.victim()
        run = Run(SimpleActionState("victim", TestAction, goal=TestGoal(goal=SUCCEED)))
        self.assertEqual(run.end(), "succeeded")
        self.assertEqual(Run(state.__class__("victim", TestAction)).end(), "succeeded")

    @mock.patch.object(action_connection, "SILENCE", 1.0)
    def test_b2_a_server_that_falls_silent_is_asked_to_stop(self):
        mute = Server("mute")
        run = Run(SimpleActionState("mute", TestAction, goal=TestGoal(goal=OBEY)))
        mute.wait_for_goals(1)
        mute.server.publish_status = lambda: None
        self.assertEqual(run.end(), "aborted")
        with mute.changed:
            self.assertTrue(mute.changed.wait_for(lambda: mute.cancels, LONG))

    def interrupt(self, kind, begun):
        """The output of a program that is interrupted when it has begun, which `begun` waits for."""
        process = subprocess.Popen(
            lean_script(os.path.join(HERE, "smach_victim.py"), kind),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.kill)
        begun(process)
        process.send_signal(signal.SIGINT)
        return process.communicate(timeout=LONG)[0]

    def test_b8_what_a_program_drives_stops_when_it_is_interrupted(self):
        for kind in ("drive", "merlin_drive"):
            output = self.interrupt(kind, lambda _: self.server.wait_for_goals(self.before + 1))
            self.assertIn("outcome preempted", output, kind)
            self.assertEqual(self.server.goals[-1].get_goal_status().status, GoalStatus.PREEMPTED, kind)
            self.assertEqual(len(self.server.goals), self.before + 1, kind)  # its machine goes on without one
            self.before += 1

    def test_b8_a_first_action_state_does_not_hold_the_preempt_handler_up(self):
        output = self.interrupt(
            "late_drive", lambda process: self.assertEqual("running\n", process.stdout.readline())
        )
        self.assertIn("outcome preempted", output)
        self.assertNotIn("still runs", output)
        self.assertEqual(len(self.server.goals), self.before)

    def victim(self):
        process = subprocess.Popen(lean_script(os.path.join(HERE, "smach_victim.py"), "server"))
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        return process

    def test_b2_b5_missing_server_is_given_up_after_server_wait_timeout(self):
        state = SimpleActionState("nowhere", TestAction, server_wait_timeout=rospy.Duration(0.2))
        self.assertEqual(Run(state).end(), "aborted")
        state = SimpleActionState("nowhere", TestAction)
        run = Run(state)
        while run.is_alive():  # the request may come before the run begins, and is not for it then
            state.request_preempt()
            run.join(0.05)
        self.assertEqual(run.end(), "preempted")

    def test_b2_result_that_is_lost_on_its_way_does_not_hang_the_state(self):
        publish = self.server.server.result_pub.publish
        self.server.server.result_pub.publish = lambda message: None
        self.addCleanup(setattr, self.server.server.result_pub, "publish", publish)
        self.assertEqual(Run(self.action(SUCCEED)).end(), "succeeded")

    def test_b3_state_whose_result_callback_failed_runs_in_another_thread(self):
        answers = [ZeroDivisionError, "unregistered", None]

        def result_cb(ud, status, result):
            answer = answers.pop(0)
            if isinstance(answer, type):
                raise answer
            return answer

        state = self.action(SUCCEED, result_cb=result_cb)
        self.assertEqual([Run(state).end() for _ in range(3)], ["aborted", "aborted", "succeeded"])

    @mock.patch.object(action_connection, "REPEAT_CANCEL", LONG)  # else a server that is slow gets two
    def test_b4_timed_out_goal_is_cancelled_once_and_leaves_no_thread(self):
        cancels = []
        subscriber = rospy.Subscriber("tempers/cancel", GoalID, cancels.append)
        self.addCleanup(subscriber.unregister)
        state = self.action(OBEY, exec_timeout=rospy.Duration(0.2))
        wait_for_publisher(subscriber, rospy.get_name())
        self.assertEqual(Run(state).end(), "aborted")
        threads = threading.active_count()
        self.assertEqual([Run(state).end() for _ in range(3)], ["aborted"] * 3)
        end = time.monotonic() + LONG
        while threading.active_count() > threads:
            self.assertLess(time.monotonic(), end, threading.enumerate())
            rospy.rostime.wallsleep(0.01)
        # The server need not see each: on a busy machine a cancel comes before its goal.
        while len({message.id for message in cancels}) < 4:
            self.assertLess(time.monotonic(), end, cancels)
            rospy.rostime.wallsleep(0.01)
        self.assertEqual(len(cancels), 4)

    def test_b5_state_can_be_made_without_a_node_and_keeps_no_process(self):
        program = (
            "import smach_ros; from actionlib.msg import *; "
            "s = smach_ros.SimpleActionState('tempers', TestAction, goal=TestGoal(goal=0)); "
            "import rospy, smach, sys; "
            "len(sys.argv) > 1 and (rospy.init_node('late'), print(s.execute(smach.UserData())))"
        )
        for arguments, expected in (([], ""), (["run"], "succeeded")):
            done = subprocess.run(
                [sys.executable, "-c", LEAN + program, *arguments],
                timeout=LONG,
                stdout=subprocess.PIPE,
                text=True,
            )
            self.assertEqual((done.returncode, done.stdout.strip()), (0, expected))

    def test_u7_goal_edited_in_place_is_a_fresh_one_each_time(self):
        def goal_cb(ud, goal):
            goal.goal += 1

        template = TestGoal(goal=SUCCEED - 1)
        state = self.action(goal=template, goal_cb=goal_cb)
        self.assertEqual([Run(state).end(), Run(state).end()], ["succeeded", "succeeded"])
        self.assertEqual(template.goal, SUCCEED - 1)
        run = Run(self.action(goal_key="g", goal_cb=goal_cb), g=template)
        run.end()
        self.assertEqual(run.ud.g.goal, SUCCEED - 1)

    def advertised(self, action):
        publishers, _, _ = rosgraph.Master(rospy.get_name()).getSystemState()
        return rospy.get_name() in dict(publishers).get(f"/{action}/goal", [])

    def wait_until_released(self, action):
        end = time.monotonic() + LONG
        while self.advertised(action):
            self.assertLess(time.monotonic(), end)
            rospy.rostime.wallsleep(0.01)

    def test_states_that_are_gone_leave_no_connection(self):
        states = [SimpleActionState("elsewhere", TestAction) for _ in range(2)]
        states.pop()
        SimpleActionState("somewhere", TestAction)
        self.wait_until_released("somewhere")  # after the first use of the other connection has ended
        self.assertTrue(self.advertised("elsewhere"), "the other state needs it")
        states.pop()
        self.wait_until_released("elsewhere")

    def test_a_state_that_is_gone_in_the_midst_of_rospy_does_not_wait_for_it(self):
        states = [SimpleActionState("elsewhere", TestAction)]

        def drop():  # as the search for garbage does, in whatever thread it comes
            with registration.get_registration_listeners().lock:
                states.clear()

        dropping = threading.Thread(target=drop, daemon=True)
        dropping.start()
        dropping.join(LONG)
        self.assertFalse(dropping.is_alive())
        self.wait_until_released("elsewhere")

    def test_broken_definitions_raise(self):
        for how in ({"goal_slots": ["speed"]}, {"result_slots": ["speed"]}):
            with self.assertRaisesRegex(smach.InvalidConstructionError, "speed"):
                self.action(**how)
        with self.assertRaises(smach.InvalidStateError):
            self.action(goal="kitchen")
        with self.assertRaises(smach.InvalidStateError):
            self.action(goal_cb="kitchen")
