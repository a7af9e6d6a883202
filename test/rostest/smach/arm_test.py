# SPDX-License-Identifier: Apache-2.0
"""The ready states of an arm over action servers of several kinds: how they end, and what is said then."""

import re
import signal
import subprocess
import sys
import threading
import unittest
from pathlib import Path

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatusArray
from merlin_msgs.msg import ManipulateAction
from std_srvs.srv import SetBool, SetBoolResponse

from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.node_path import LEAN, node_path

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "real-robot.md"
OUTCOMES = ["succeeded", "not_found", "aborted", "preempted"]
STATES = ("pick", "place", "open", "close")


def machine(name, *args, **options):
    sm = MerlinSM(OUTCOMES)
    sm.userdata.o = "mug"
    with sm:
        sm.add("ARM", MerlinStateFactory.create(name, *args, server_wait=LONG, **options))
    return sm


class Run:
    """A machine that runs in a thread of its own."""

    def __init__(self, sm):
        self.machine = sm
        self._outcomes = []
        self._thread = threading.Thread(target=lambda: self._outcomes.append(sm.execute()), daemon=True)
        self._thread.start()

    def end(self):
        self._thread.join(LONG)
        return self._outcomes


class Arm(unittest.TestCase):
    def foreign(self, name, execute):
        """A server of plain actionlib."""
        server = actionlib.SimpleActionServer(name, ManipulateAction, execute, auto_start=False)
        server.start()
        return server

    def begun(self, robot, action):
        """Waits until a goal of a robot's arm is active."""
        heard = Received(f"/{robot}/{action}/status", GoalStatusArray)
        self.addCleanup(heard.close)
        heard.wait(lambda status: any(each.status == 1 for each in status.status_list))

    def test_each_state_reaches_its_action(self):
        for name in STATES:
            sm = machine(name, "{o}", "desk", action=f"/ann/{name}")
            self.assertEqual(sm.execute(), "succeeded", sm.reason)

    def test_what_is_there_is_seen_and_what_is_not_is_not_found(self):
        self.assertEqual(machine("detect", "{o}").execute(), "succeeded")
        sm = machine("detect", "apple", "desk")
        self.assertEqual(sm.execute(), "not_found")
        self.assertEqual(sm.reason, "apple was not seen at desk")

    def test_the_words_of_a_foreign_server_are_the_reason(self):
        goals = []

        def fail(goal):
            goals.append(goal)
            server.set_aborted(text="the mug slipped")

        server = self.foreign("/foreign/pick", fail)
        sm = machine("pick", "{o}", "desk", action="/foreign/pick")
        self.assertEqual(sm.execute(), "aborted")
        self.assertEqual(sm.reason, "/foreign/pick aborted: the mug slipped")
        self.assertEqual((goals[0].object, goals[0].place), ("mug", "desk"))

    def test_a_cancel_stops_the_arm_and_the_other_robot_goes_on(self):
        run = Run(machine("pick", "{o}", action="/bob/pick"))
        self.begun("bob", "pick")
        self.assertEqual(machine("pick", "{o}", action="/ann/pick").execute(), "succeeded")
        run.machine.request_preempt()
        self.assertEqual(run.end(), ["preempted"])

    def test_an_arm_does_one_action_at_a_time(self):
        run = Run(machine("place", "{o}", action="/bob/place"))
        self.begun("bob", "place")
        other = Run(machine("open", "fridge", action="/bob/open"))
        self.assertEqual(other.end(), ["aborted"])
        reason = "/bob/open aborted: the robot does another action; cancel that first"
        self.assertEqual(other.machine.reason, reason)
        run.machine.request_preempt()
        self.assertEqual(run.end(), ["preempted"])

    def test_a_server_that_does_not_stop_is_named(self):
        may_end = threading.Event()
        begun = threading.Event()

        def hang(goal):
            begun.set()
            may_end.wait(LONG)

        self.foreign("/deaf/close", hang)
        self.addCleanup(may_end.set)
        run = Run(machine("close", "fridge", action="/deaf/close", cancel_limit=0.3))
        self.assertTrue(begun.wait(LONG))
        run.machine.request_preempt()
        self.assertEqual(run.end(), ["aborted"])
        self.assertIn("/deaf/close did not stop within 0.3 s", run.machine.reason)

    def test_an_arm_that_is_killed_ends_the_state(self):
        command = [node_path("merlin_actions", "simulated_action_server"), "__ns:=carl"]
        parameters = ["_action:=open", "_type:=merlin_msgs/Manipulate", "_duration:=600"]
        server = subprocess.Popen([*command, *parameters])
        self.addCleanup(server.wait)
        self.addCleanup(server.kill)
        run = Run(machine("open", "fridge", action="/carl/open"))
        self.begun("carl", "open")
        server.send_signal(signal.SIGKILL)
        self.assertEqual(run.end(), ["aborted"])
        self.assertIn("/carl/open was lost", run.machine.reason)

    def test_an_arm_that_is_not_there_is_named(self):
        sm = MerlinSM(OUTCOMES)
        with sm:
            sm.add("ARM", MerlinStateFactory.create("pick", "mug", server_wait=0.2))
        self.assertEqual(sm.execute(), "aborted")
        self.assertEqual(sm.reason, "no action server /pick within 0.2 s (its status was never heard)")

    def test_the_node_of_the_documents_serves_an_arm(self):
        codes = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S)
        (code,) = (each for each in codes if 'init_node("arm")' in each)
        node = subprocess.Popen([sys.executable, "-c", LEAN + code, "__ns:=dora"])
        self.addCleanup(node.wait)
        self.addCleanup(node.send_signal, signal.SIGINT)
        answers = {True: SetBoolResponse(True, ""), False: SetBoolResponse(False, "no vacuum")}
        service = rospy.Service("/dora/gripper/suction", SetBool, lambda request: answers[request.data])
        self.addCleanup(service.shutdown)
        self.assertEqual(machine("pick", "mug", action="/dora/pick").execute(), "succeeded")
        sm = machine("place", "mug", "desk", action="/dora/place")
        self.assertEqual(sm.execute(), "aborted")
        self.assertEqual(sm.reason, "/dora/place aborted: no vacuum")
