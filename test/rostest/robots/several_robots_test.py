#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Two robots in one plan (docs/several-robots.md): each runs its own actions, comes and goes by itself."""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import unittest
from pathlib import Path
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Twist
from merlin_msgs.msg import KnowledgeChanges, RobotHost
from move_base_msgs.msg import MoveBaseActionResult
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService
from std_srvs.srv import SetBool

import rostest
import smach
from merlin_actions.merlin_action_server import MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_pddl.breakpoints import BreakpointError
from merlin_sm.breakpoint_client import MachineNodes
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.announced_interfaces import wait_for_interfaces
from merlin_test.held_drives import HeldDrives
from merlin_test.node_path import node_path
from merlin_test.process_signals import strike
from merlin_test.topic_links import init_node, sends, wait_for_publisher, wait_for_publishers

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "bench"))  # not installed

from stress.robots_stress import RobotsStress

SUCCEEDED, FAILED = ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE, ActionFeedback.ACTION_FAILED
PLACES = ("dorm_room", "bathroom", "kitchen", "main_door")
ACTIONS = "[merlin_actions.actions.drive:Drive]"


class Presses(smach.State):
    """Ends as soon as two of it run at once."""

    together = threading.Barrier(2)

    def __init__(self):
        super().__init__(["succeeded"])

    def execute(self, userdata):
        self.together.wait(LONG)
        return "succeeded"


class Print(MerlinActionSM):
    parameters = ["n"]
    concurrent = 2

    def build(self):
        self.add("PRESS", Presses())


class SeveralRobots(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.changed = threading.Condition()
        cls.answers, cls.drives = [], []
        cls.unavailable = []  # robots as they became so: one may be back before a slow test looks
        cls.moves = {"ann": 0, "bob": 0}
        cls.knowledge = MerlinROSPlanAssistant()
        changes = rospy.Subscriber(
            "rosplan_knowledge_base/changes", KnowledgeChanges, cls.change, tcp_nodelay=True
        )
        wait_for_publishers(changes)
        cls.hosts = {}
        rospy.Subscriber("rosplan_knowledge_base/robots", RobotHost, cls.hear, tcp_nodelay=True)
        for robot in cls.moves:
            rospy.Subscriber(f"{robot}/cmd_vel", Twist, cls.move, robot, tcp_nodelay=True)
        rospy.Subscriber("bob/move_base/result", MoveBaseActionResult, cls.drove, tcp_nodelay=True)
        cls.feedback = rospy.Subscriber(
            "rosplan_plan_dispatcher/action_feedback", ActionFeedback, cls.answer, tcp_nodelay=True
        )
        cls.dispatches = rospy.Publisher(
            "rosplan_plan_dispatcher/action_dispatch", ActionDispatch, queue_size=10
        )
        cls.printer = MerlinActionServer(Print())
        cls.printer.start()
        wait_for_interfaces("drive", "print")
        cls.client = MerlinExecutorClient()
        assert cls.client.wait_for_executor(LONG)
        cls.number = 0

    @classmethod
    def tearDownClass(cls):
        cls.printer.shutdown()

    @classmethod
    def change(cls, change):
        with cls.changed:
            removed = [item for item in change.removed if item.attribute_name == "available"]
            cls.unavailable += [item.values[0].value for item in removed]
            cls.changed.notify_all()

    @classmethod
    def hear(cls, host):
        with cls.changed:
            cls.hosts[host.robot] = host
            cls.changed.notify_all()

    @classmethod
    def move(cls, velocity, robot):
        if velocity.linear.x:
            with cls.changed:
                cls.moves[robot] += 1
                cls.changed.notify_all()

    @classmethod
    def drove(cls, result):
        with cls.changed:
            cls.drives.append(result.status)
            cls.changed.notify_all()

    @classmethod
    def answer(cls, message):
        with cls.changed:
            cls.answers.append(message)
            cls.changed.notify_all()

    def driven(self, began):
        """How the drives of bob ended that began after a time; the end of an earlier one may come late."""
        return [status.status for status in self.drives if status.goal_id.stamp >= began]

    def until(self, happens, what):
        with self.changed:
            self.assertTrue(self.changed.wait_for(happens, LONG), what)

    def until_true(self, condition):
        self.until(lambda: self.knowledge.holds(condition), condition)

    def setUp(self):
        while not sends(rospy.get_name(), self.dispatches.resolved_name, "/merlin_bridges"):
            rospy.rostime.wallsleep(0.02)
        wait_for_publisher(self.feedback, "/merlin_bridges")
        for robot in ("ann", "bob"):
            self.until_true(f"(available {robot})")
        self.knowledge.remove_facts(self.knowledge.facts("visited"))

    def dispatch(self, name, **parameters):
        SeveralRobots.number += 1
        message = ActionDispatch(
            action_id=self.number,
            plan_id=7,
            name=name,
            parameters=[KeyValue(key.strip("_"), value) for key, value in parameters.items()],
        )
        self.dispatches.publish(message)
        return message

    def place(self, robot):
        (at,) = [fact for fact in self.knowledge.facts("robot_at") if robot in fact]
        return at.strip("()").split()[-1]

    def drive(self, robot, to="kitchen"):
        return self.dispatch("drive", r=robot, from_=self.place(robot), to=to)

    def driving(self, robot):
        """Waits until a robot drives whose drives do not end by themselves."""
        before = self.moves[robot]
        self.until(lambda: self.moves[robot] > before + 1, f"{robot} drives")

    def final(self, dispatch):
        def found():
            return [
                answer
                for answer in self.answers
                if (answer.plan_id, answer.action_id) == (7, dispatch.action_id)
                and answer.status in (SUCCEEDED, FAILED)
            ]

        self.until(found, f"an answer to {dispatch}")
        return found()[0].status, {entry.key: entry.value for entry in found()[0].information}

    def cancel(self, dispatch):
        dispatch.name = "cancel_action"
        self.dispatches.publish(dispatch)

    def failed(self, dispatch):
        status, said = self.final(dispatch)
        self.assertEqual(status, FAILED)
        return said

    @staticmethod
    def pid(node):
        return ServerProxy(rosgraph.Master("/test").lookupNode(node)).getPid("/test")[2]

    def test_each_robot_runs_its_own_and_one_is_cancelled(self):
        ann, bob = self.drive("ann"), self.drive("bob")
        self.driving("ann")
        self.cancel(ann)
        self.assertEqual(self.failed(ann)["reason"], "cancelled")
        self.assertTrue(self.knowledge.holds("(robot_at ann anywhere)"))
        self.assertEqual(self.final(bob)[0], SUCCEEDED)
        self.assertTrue(self.knowledge.holds("(robot_at bob kitchen)"))

    def test_a_state_of_one_robot_is_left_by_its_name(self):
        drives = HeldDrives("bob")
        self.addCleanup(drives.end)
        drives.hold()
        ann, bob = self.drive("ann"), self.drive("bob")
        self.driving("ann")
        drives.wait_driving()
        with self.assertRaisesRegex(BreakpointError, "no machine has a state DRIVE/DRIVE; .*: ann, bob"):
            MachineNodes().leave("DRIVE/DRIVE", "aborted", "Ana")
        MachineNodes().leave("ann/DRIVE/DRIVE", "aborted", "Ana")
        self.failed(ann)
        drives.end()
        self.assertEqual(self.final(bob)[0], SUCCEEDED)

    def test_a_second_drive_of_one_robot_waits_for_the_first(self):
        first = self.drive("bob", "bathroom")
        second = self.dispatch("drive", r="bob", from_="bathroom", to="main_door")
        self.assertEqual((self.final(first)[0], self.final(second)[0]), (SUCCEEDED, SUCCEEDED))
        ends = [a.action_id for a in self.answers if (a.plan_id, a.status) == (7, SUCCEEDED)]
        self.assertLess(ends.index(first.action_id), ends.index(second.action_id))

    def test_an_action_without_a_robot_runs_as_often_at_once_as_its_class_says(self):
        sheets = [self.dispatch("print", n=note) for note in ("one", "two")]
        self.assertEqual([self.final(sheet)[0] for sheet in sheets], [SUCCEEDED] * 2)

    def test_a_robot_that_does_not_exist_is_named(self):
        # The problem says that dora is available; no host does.
        self.until(lambda: not self.knowledge.holds("(available dora)"), "dora is not available")
        self.knowledge.add_facts("(robot_at dora anywhere)")
        dora = self.drive("dora")
        self.cancel(dora)
        self.assertEqual(self.failed(dora)["reason"], "cancelled")
        self.assertTrue(self.knowledge.holds("(robot_at dora anywhere)"))
        self.knowledge.remove_facts("(robot_at dora anywhere)")

    def test_a_robot_that_is_taken_out_stops_and_takes_nothing(self):
        available = rospy.ServiceProxy("ann/merlin/available", SetBool)
        ann, bob = self.drive("ann"), self.drive("bob")
        self.driving("ann")
        self.assertTrue(available(False).success)
        said = self.failed(ann)
        self.assertEqual(said, {"reason": "robot ann was taken out by its operator", "robot": "ann"})
        self.assertFalse(self.knowledge.holds("(available ann)"))
        self.assertTrue(self.knowledge.holds("(robot_at ann anywhere)"))
        self.assertIn("taken out", self.failed(self.drive("ann"))["reason"])
        self.assertEqual(self.final(bob)[0], SUCCEEDED)
        life = self.hosts["ann"].life
        os.kill(self.pid("/ann/merlin_fsm_host"), signal.SIGKILL)
        self.until(lambda: self.hosts["ann"].life != life, "the host of ann lives again")
        self.assertIn("taken out", self.hosts["ann"].out)
        self.assertFalse(self.knowledge.holds("(available ann)"))
        available.wait_for_service(LONG)
        self.assertTrue(available(True).success)
        self.until_true("(available ann)")

    def test_a_robot_that_hangs_or_dies_fails_its_actions_and_comes_back(self):
        # Meanwhile two wait for robots that do not exist: of one no host was heard, the other is a place.
        nowhere = [
            self.dispatch("drive", r=robot, from_="anywhere", to="kitchen") for robot in ("dora", "hall")
        ]
        for number, reason in ((signal.SIGSTOP, "silent"), (signal.SIGKILL, "robot ann is gone")):
            self.setUp()
            host = self.pid("/ann/merlin_fsm_host")
            ann, bob = self.drive("ann"), self.drive("bob")
            self.driving("ann")
            strike(host, number)
            said = self.failed(ann)
            self.assertIn(reason, said["reason"])
            self.assertEqual(said["robot"], "ann")
            self.assertTrue(self.knowledge.holds("(robot_at ann anywhere)"))
            self.assertEqual(self.final(bob)[0], SUCCEEDED)
            if number == signal.SIGSTOP:
                self.assertFalse(self.knowledge.holds("(available ann)"))
                os.kill(host, signal.SIGCONT)
            # The one that died is started again.
            self.until_true("(available ann)")
            again = self.drive("ann")
            self.driving("ann")
            self.cancel(again)
            self.assertEqual(self.failed(again)["reason"], "cancelled")
        for dispatch, robot in zip(nowhere, ("dora", "hall")):
            self.assertRegex(
                self.failed(dispatch)["reason"], f"no host says that it is robot {robot} .*ann, bob"
            )

    def test_a_request_for_one_robot_goes_on_when_its_host_is_back(self):
        available = rospy.ServiceProxy("bob/merlin/available", SetBool)
        available(False)
        self.until(lambda: not self.knowledge.holds("(available bob)"), "bob is out")
        request = self.client.send("(visited kitchen)")
        self.driving("ann")
        self.unavailable.clear()
        os.kill(self.pid("/ann/merlin_fsm_host"), signal.SIGKILL)
        self.until(lambda: "ann" in self.unavailable or request.done, "ann is gone")
        self.until_true("(available ann)")
        self.driving("ann")
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "CANCELLED", request.result.reason)
        available(True)

    def test_a_plan_goes_on_without_the_robot_that_has_left(self):
        began = rospy.Time.now()
        request = self.client.send("(and (visited dorm_room) (visited bathroom) (visited kitchen))")
        self.driving("ann")
        available = rospy.ServiceProxy("ann/merlin/available", SetBool)
        available(False)
        self.assertTrue(request.wait(LONG))
        available(True)
        result = request.result
        self.assertEqual(outcome_name(result.outcome), "SUCCEEDED", result.reason)
        self.assertGreaterEqual(result.replans, 1)
        self.until(lambda: len(self.driven(began)) >= 3, "bob has driven everywhere")
        self.assertEqual(set(self.driven(began)), {GoalStatus.SUCCEEDED}, "none was cancelled")

    def test_a_robot_that_leaves_while_it_is_idle_does_not_stop_the_others(self):
        available = rospy.ServiceProxy("ann/merlin/available", SetBool)
        parse = rospy.ServiceProxy("rosplan_parsing_interface/parse_plan_from_file", ParsingService)
        dispatch = rospy.ServiceProxy("rosplan_plan_dispatcher/dispatch_plan", DispatchService)
        began = rospy.Time.now()
        with tempfile.NamedTemporaryFile("w", suffix=".pddl") as plan:
            plan.write(f"0.0: (drive bob {self.place('bob')} kitchen) [30.0]\n")
            plan.write(f"0.0: (drive ann {self.place('ann')} bathroom) [30.0]\n")
            plan.flush()
            self.assertTrue(parse(plan.name).plan_parsed)
        available(False)
        self.until(lambda: not self.knowledge.holds("(available ann)"), "ann has left")
        self.assertFalse(dispatch().success)
        available(True)
        self.assertTrue(self.knowledge.holds("(visited kitchen)"))
        self.until(lambda: self.driven(began), "bob has driven")
        self.assertEqual(self.driven(began), [GoalStatus.SUCCEEDED])

    def test_random_cancels_and_robots_that_come_and_go(self):
        stress = RobotsStress(["ann", "bob"], PLACES, seed=21, longest=1.0, always_cancel=True)
        cycles = rospy.get_param("~cycles")
        stress.run(cycles)
        self.assertEqual(stress.done["cancel"], cycles)

    def host(self, namespace, robot):
        """Starts another host."""
        rospy.set_param(f"{namespace}/world", rospy.get_param("ann/world"))
        host = subprocess.Popen(
            [node_path("merlin_actions", "fsm_host"), f"__ns:={namespace}", f"_actions:={ACTIONS}"]
            + [f"_robot:={robot}", "rosplan_knowledge_base:=/rosplan_knowledge_base"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

        def end():
            if host.poll() is None:
                os.killpg(host.pid, signal.SIGKILL)
                host.communicate()

        self.addCleanup(end)
        return host

    def test_a_robot_is_added_while_the_system_runs(self):
        self.until(lambda: not self.knowledge.holds("(available carl)"), "carl is not available")
        host = self.host("/carl", "carl")
        self.until_true("(available carl)")
        self.knowledge.add_facts("(robot_at carl anywhere)")
        # It has the machines, and no move_base.
        self.assertIn("move_base", self.failed(self.drive("carl"))["reason"])
        os.killpg(host.pid, signal.SIGINT)
        self.until(lambda: not self.knowledge.holds("(available carl)"), "carl has left")
        host.communicate(timeout=LONG)
        self.assertIn("has ended", self.failed(self.drive("carl"))["reason"])
        self.knowledge.remove_facts([fact for fact in self.knowledge.facts("robot_at") if "carl" in fact])

    def test_a_host_with_a_name_that_cannot_be_is_refused(self):
        for robot, reason in (
            ("kitchen", "robot kitchen is of type place, not robot"),
            ("ann", "/ann/merlin_fsm_host says already that it is robot ann"),
        ):
            host = self.host("/wrong", robot)
            said = host.communicate(timeout=LONG)[0].decode()
            self.assertEqual(host.returncode, 2, said)
            self.assertIn(reason, said)
        self.assertTrue(self.knowledge.holds("(available ann)"))


if __name__ == "__main__":
    init_node("several_robots_test")
    rostest.rosrun("merlin_test", "several_robots", SeveralRobots)
