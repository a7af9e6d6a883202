#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""State machines whose code does what it must not: their goals are answered, and the next one works."""

import threading
import time
import unittest
from unittest import mock

import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from merlin_msgs.msg import RunActionAction, RunActionGoal
from move_base_msgs.msg import MoveBaseAction
from py_trees.behaviours import Failure
from py_trees.common import ParallelPolicy
from py_trees.composites import Parallel, Selector
from rospy.impl.registration import get_topic_manager

import rostest
import smach
from merlin_actions import merlin_action_server
from merlin_actions.merlin_action_bt import MerlinActionBT
from merlin_actions.merlin_action_server import MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_ros.actions.action_client import ActionClient
from merlin_ros.actions.action_server import ActionServer
from merlin_ros.health import ERROR
from merlin_sm.states.action_state import give_up_goals, shared_client
from merlin_test import LONG
from merlin_test.failure_texts import named_case
from merlin_test.topic_links import init_node

CANCEL_LIMIT = 1.0


class Stubborn(smach.State):
    """Goes on until the test ends, through every cancel; at its second run it succeeds at once."""

    release = threading.Event()
    runs = 0

    def __init__(self):
        super().__init__(["succeeded"])

    def execute(self, userdata):
        Stubborn.runs += 1
        if Stubborn.runs == 1:
            self.release.wait()
        return "succeeded"


class LoopsInPreempt(Stubborn):
    def request_preempt(self):
        super().request_preempt()
        self.release.wait()


class RaisesInPreempt(Stubborn):
    def request_preempt(self):
        super().request_preempt()
        raise SystemExit("I will not stop")


class Exits(smach.State):
    def __init__(self):
        super().__init__(["succeeded"])

    def execute(self, userdata):
        raise SystemExit(3)


class Recurses(smach.State):
    def __init__(self):
        super().__init__(["succeeded"])

    def execute(self, userdata):
        return self.execute(userdata)


def machine(name, state):
    def build(self):
        self.add("ONLY", state())

    return type(name, (MerlinActionSM,), {"build": build})()


class TreeBesideStubborn(MerlinActionBT):
    """As the machine below, as a behaviour tree."""

    def tree(self):
        drive = self.behaviour("DRIVE", self.state("navigation", target=pose()))
        stubborn = self.behaviour("STUBBORN", Stubborn())
        return Parallel("BOTH", ParallelPolicy.SuccessOnAll(), [drive, stubborn])


class DriveInTree(MerlinActionBT):
    """Drives; the drive of a selector that is not the first choice."""

    def tree(self):
        drive = self.behaviour("DRIVE", self.state("navigation", target=pose(), cancel_limit=LONG))
        return Selector("ANY", memory=True, children=[Failure("NO"), drive])


class DriveBesideStubborn(MerlinActionSM):
    """Drives, and beside it runs a state that does not stop."""

    def build(self):
        both = smach.Concurrence(
            ["succeeded", "aborted", "preempted"],
            "aborted",
            outcome_map={"succeeded": {"DRIVE": "succeeded"}},
        )
        with both:
            smach.Concurrence.add("DRIVE", self.state("navigation", target=pose()))
            smach.Concurrence.add("STUBBORN", Stubborn())
        self.add("BOTH", both)


def pose():
    target = PoseStamped()
    target.header.frame_id = "map"
    target.pose.orientation.w = 1.0
    return target


class MachineHost(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.drives = []
        cls.stopped = {}  # drive -> set when its stop was requested
        # One for all tests: the states' client outlives them, and where one server goes and the next comes at
        # once, rospy still has the link of the first and makes none for the second.
        cls.base = ActionServer("move_base", MoveBaseAction, cls.drive, cls.stop)
        cls.base.start()
        assert shared_client("move_base", MoveBaseAction).wait_for_server(LONG)

    @classmethod
    def tearDownClass(cls):
        cls.base.shutdown()

    @classmethod
    def drive(cls, goal):
        goal.accept()
        cls.stopped[goal.id] = threading.Event()
        cls.drives.append(goal.id)

    @classmethod
    def stop(cls, goal):
        cls.stopped[goal.id].set()
        goal.cancelled()

    def setUp(self):
        Stubborn.runs = 0
        Stubborn.release = threading.Event()
        self.addCleanup(Stubborn.release.set)

    def serve(self, action, cancel_limit=CANCEL_LIMIT):
        server = MerlinActionServer(action, cancel_limit)
        server.start()
        self.addCleanup(server.shutdown)
        client = ActionClient(f"actions/{server.operator}", RunActionAction)
        self.addCleanup(client.shutdown)
        self.assertTrue(client.wait_for_server(LONG))
        # A client hears of a connection before the server's publisher uses it: feedback could be lost.
        self.until(lambda: f"{client.name}/feedback" in self.followed(), "feedback is followed")
        return server, client

    @staticmethod
    def followed():
        """The topics that this process sends to a subscriber."""
        return {topic for _, _, way, _, topic, *_ in get_topic_manager().get_pub_sub_info() if way == "o"}

    def until(self, holds, what):
        end = time.monotonic() + LONG
        while not holds():
            self.assertLess(time.monotonic(), end, what)
            rospy.rostime.wallsleep(0.01)

    def start(self, client):
        goal = client.send(RunActionGoal())
        end = time.monotonic() + LONG
        while goal.status != GoalStatus.ACTIVE or not goal.feedback:
            self.assertFalse(goal.wait(0.01))
            self.assertLess(time.monotonic(), end, goal.status)
        return goal

    def finish(self, goal):
        self.assertTrue(goal.wait(LONG))
        return goal

    def test_what_does_not_stop_is_named_and_replaced(self):
        for name, state in (
            ("IgnoresPreempt", Stubborn),
            ("LoopsInPreempt", LoopsInPreempt),
            ("RaisesInPreempt", RaisesInPreempt),
        ):
            with named_case(name):
                self.setUp()
                server, client = self.serve(machine(name, state))
                goal = self.start(client)
                goal.cancel()
                self.finish(goal)
                self.assertEqual(goal.status, GoalStatus.ABORTED)
                self.assertIn("in state ONLY did not stop", goal.result.reason)
                self.assertIn("ONLY", goal.result.unstopped)
                self.assertEqual(server.health().level, ERROR)
                # The next goal works while the first run still hangs.
                following = self.finish(client.send(RunActionGoal()))
                self.assertEqual(following.status, GoalStatus.SUCCEEDED)

    def test_a_goal_that_runs_ends_with_the_class_it_began_with(self):
        class Asks(smach.State):
            said = "before"
            go_on = threading.Event()

            def __init__(self):
                super().__init__(["aborted"])

            def execute(self, userdata):
                self.go_on.wait()
                raise ValueError(self.said)

        class AsksAnew(Asks):
            said = "after"

        server, client = self.serve(machine("Ask", Asks), LONG)
        shown = server.machine
        goal = self.start(client)
        edited = machine("Ask", AsksAnew)
        self.assertTrue(server.renew(edited), "a goal runs")
        goals = [goal, client.send(RunActionGoal())]  # the second preempts the first
        Asks.go_on.set()
        self.assertIn("before", self.finish(goals[0]).result.reason)
        self.assertIn("after", self.finish(goals[1]).result.reason)
        self.assertIsNot(server.machine, shown)
        self.assertFalse(server.renew(machine("Ask", Asks)), "nothing runs")
        self.assertIn("before", self.finish(client.send(RunActionGoal())).result.reason)

    def test_a_newer_goal_does_not_wait_for_ever(self):
        _, client = self.serve(machine("Busy", Stubborn))
        first = self.start(client)
        second = self.finish(client.send(RunActionGoal()))
        self.assertEqual(second.status, GoalStatus.SUCCEEDED)
        self.assertEqual(self.finish(first).status, GoalStatus.ABORTED)

    def test_what_ends_as_it_is_abandoned_is_answered_once_and_the_next_goal_runs(self):
        server, client = self.serve(machine("EndsLate", Stubborn))
        first = self.start(client)
        (run,) = [thread for thread in threading.enumerate() if thread.name == f"machine {server.operator}"]

        def end_meanwhile(goal):
            Stubborn.release.set()
            run.join(LONG)
            give_up_goals(goal)

        with mock.patch.object(merlin_action_server, "give_up_goals", end_meanwhile):
            second = client.send(RunActionGoal())
            self.assertEqual(self.finish(first).status, GoalStatus.ABORTED)
            self.assertEqual(self.finish(second).status, GoalStatus.SUCCEEDED)
        self.assertFalse(run.is_alive())
        self.assertIn("did not stop", first.result.reason)

    def test_whatever_a_state_raises_its_goal_is_answered(self):
        for name, state in (("Exits", Exits), ("Recurses", Recurses)):
            with named_case(name):
                _, client = self.serve(machine(name, state))
                for _ in range(2):
                    goal = self.finish(client.send(RunActionGoal()))
                    self.assertEqual(goal.status, GoalStatus.ABORTED)
                    self.assertTrue(goal.result.reason)

    def test_what_an_abandoned_machine_drives_is_stopped(self):
        for action in (DriveBesideStubborn, TreeBesideStubborn):
            with named_case(action.__name__):
                self.setUp()
                stopped, goal = self.cancel_a_drive(action())
                self.assertTrue(stopped.wait(LONG))
                self.assertIn("BOTH/STUBBORN", goal.result.unstopped)

    def test_the_drive_of_a_tree_is_cancelled_with_it(self):
        stopped, goal = self.cancel_a_drive(DriveInTree(), "DRIVE_IN_TREE/ANY/DRIVE", LONG)
        self.assertTrue(stopped.is_set())
        self.assertEqual(goal.status, GoalStatus.PREEMPTED)

    def cancel_a_drive(self, action, state="", cancel_limit=CANCEL_LIMIT):
        _, client = self.serve(action, cancel_limit)
        before = len(self.drives)
        goal = self.start(client)
        self.until(lambda: len(self.drives) > before and state in goal.feedback.state, goal.feedback)
        self.assertFalse(goal.wait(0.0))
        goal.cancel()
        return self.stopped[self.drives[-1]], self.finish(goal)


if __name__ == "__main__":
    init_node("machine_host_test")
    rostest.rosrun("merlin_test", "machine_host", MachineHost)
