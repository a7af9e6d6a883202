# SPDX-License-Identifier: Apache-2.0
"""The planner interface: every outcome reaches its caller with a reason, and a cancel kills the planner."""

import itertools
import os
import stat
import tempfile
import threading
import time
import unittest
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import GoalDeadline, PlannerStatus, PlanWithoutAction, PlanWithoutGoal
from rosplan_dispatch_msgs.msg import PlanAction, PlanGoal
from rosplan_dispatch_msgs.srv import PlanningService
from std_msgs.msg import String
from std_srvs.srv import Empty

from merlin_ros.actions.action_client import ActionClient
from merlin_ros.service_proxy import ServiceError
from merlin_test import LONG
from merlin_test.failure_texts import named_case
from merlin_test.process_signals import gone
from merlin_test.topic_links import patient_service

NODE = "/stages/rosplan_planner_interface"


class Planner(unittest.TestCase):
    numbers = itertools.count()

    @classmethod
    def setUpClass(cls):
        cls.domain = rospy.get_param(f"{NODE}/domain_path")
        cls.folder = tempfile.TemporaryDirectory()
        cls.problem_text = (Path(cls.domain).parent / "problem.pddl").read_text()
        cls.params = patient_service(f"{NODE}/planning_server_params", PlanningService)
        cls.plain = patient_service(f"{NODE}/planning_server", Empty)
        cls.action = ActionClient(f"{NODE}/start_planning", PlanAction)
        cls.changed = threading.Condition()
        cls.plans, cls.statuses = [], []
        cls.subscribers = [
            rospy.Subscriber(f"{NODE}/planner_output", String, lambda m: cls.note(cls.plans, m.data)),
            rospy.Subscriber(f"{NODE}/planner_status", PlannerStatus, lambda m: cls.note(cls.statuses, m)),
        ]
        cls.problem_topic = rospy.Publisher("/stages/problem", String, queue_size=1, latch=True)
        assert cls.params.wait(LONG) and cls.action.wait_for_server(LONG)

    @classmethod
    def note(cls, target, value):
        with cls.changed:
            target.append(value)
            cls.changed.notify_all()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def setUp(self):
        with self.changed:
            self.plans.clear()
            self.statuses.clear()

    def status(self, state):
        with self.changed:
            self.assertTrue(
                self.changed.wait_for(lambda: any(s.state == state for s in self.statuses), LONG),
                self.statuses,
            )
            return [s for s in self.statuses if s.state == state][-1]

    def problem(self, goal):
        path = Path(self.folder.name) / "problem.pddl"
        path.write_text(self.problem_text.replace("(:goal (in_service))", f"(:goal (and {goal}))"))
        return str(path)

    def script(self, body):
        path = Path(self.folder.name) / f"planner{next(self.numbers)}.sh"
        path.write_text("#!/bin/sh\n" + body)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return f"{path} DOMAIN PROBLEM"

    def goal(self, goal="(checked kitchen)", command=""):
        return PlanGoal(domain_path=self.domain, problem_path=self.problem(goal), planner_command=command)

    def plan(self, goal, command=""):
        return self.params(self.domain, self.problem(goal), "", command, False).plan_found

    def test_a_plan_does_without_what_is_left_out(self):
        client = ActionClient(f"{NODE}/plan_without", PlanWithoutAction)
        self.assertTrue(client.wait_for_server(LONG))
        goal = "(robot_at bathroom)"
        for without, state in (
            (["(navigate anywhere bathroom)"], "SOLVED"),
            (["(navigate * bathroom)"], "UNSOLVABLE"),
            (["(fly * bathroom)"], "INVALID"),
        ):
            sent = client.send(PlanWithoutGoal(plan=self.goal(goal), without=without))
            self.assertTrue(sent.wait(LONG))
            self.assertEqual(sent.result.result_status, state, sent.text)
            if state == "SOLVED":
                with self.changed:
                    # An earlier test's plan may come first; none of them has to do with the bathroom.
                    found = self.changed.wait_for(
                        lambda: [plan for plan in self.plans if "bathroom" in plan.lower()], LONG
                    )
                self.assertTrue(found, self.plans)
                self.assertNotIn("(navigate anywhere bathroom)", found[0].lower())
        self.assertTrue(self.plan(goal))
        with self.changed:
            fits = "(navigate anywhere bathroom)"
            self.assertTrue(self.changed.wait_for(lambda: fits in self.plans[-1].lower(), LONG), self.plans)

    def test_a_plan_begins_where_what_runs_ends(self):
        client = ActionClient(f"{NODE}/plan_without", PlanWithoutAction)
        self.assertTrue(client.wait_for_server(LONG))
        drive = "(navigate anywhere dorm_room)"
        for after, state in (([drive], "SOLVED"), (["(fly dorm_room)"], "INVALID")):
            sent = client.send(PlanWithoutGoal(plan=self.goal("(checked dorm_room)"), after=after))
            self.assertTrue(sent.wait(LONG))
            self.assertEqual(sent.result.result_status, state, sent.text)
        self.assertIn("what runs cannot be planned after: unknown operator 'fly'", sent.text)

        def found():
            return [plan for plan in self.plans if plan.startswith(f"; after {drive}\n")]

        with self.changed:
            self.assertTrue(self.changed.wait_for(found, LONG), self.plans)
        steps = found()[0].split("\n", 1)[1]
        self.assertIn("(ask dorm_room)", steps)
        self.assertNotIn("navigate", steps)

    def test_a_plan_is_in_time_or_it_is_proven_that_none_is(self):
        client = ActionClient(f"{NODE}/plan_without", PlanWithoutAction)
        self.assertTrue(client.wait_for_server(LONG))
        goal = "(checked bathroom)"
        for within, state in ((600.0, "SOLVED"), (4.0, "UNSOLVABLE"), (float("nan"), "INVALID")):
            deadlines = [GoalDeadline([goal], within)]
            sent = client.send(PlanWithoutGoal(plan=self.goal(goal), deadlines=deadlines))
            self.assertTrue(sent.wait(LONG))
            self.assertEqual(sent.result.result_status, state, sent.text)
            self.assertEqual(len(sent.result.reached), state != "INVALID")
        with self.changed:
            found = self.changed.wait_for(lambda: any("(ask bathroom)" in plan for plan in self.plans), LONG)
            self.assertTrue(found, self.plans)
            self.assertFalse(any("collect" in plan for plan in self.plans), self.plans)

    def test_a_plan_is_published_and_latched(self):
        self.assertTrue(self.plan("(checked kitchen)"))
        status = self.status(PlannerStatus.SOLVED)
        self.assertEqual(status.planner, "kairos")
        late = []
        subscriber = rospy.Subscriber(f"{NODE}/planner_output", String, lambda m: self.note(late, m.data))
        self.addCleanup(subscriber.unregister)
        with self.changed:
            # rospy hands a further subscriber what this process received last: first an older plan.
            arrived = self.changed.wait_for(lambda: any("anywhere kitchen" in plan for plan in late), LONG)
            self.assertTrue(arrived, late)

    def test_why_there_is_no_plan_reaches_service_action_and_topic(self):
        self.assertTrue(self.plan("(robot_at main_door)"))

        def arrived():
            return any("main_door" in plan.lower() for plan in self.plans)

        with self.changed:  # no other test drives there: when its plan is here, theirs are
            self.assertTrue(self.changed.wait_for(arrived, LONG), self.plans)
        for goal, command, state, part in (
            ("(robot_at kitchen) (robot_at bathroom)", "", "UNSOLVABLE", ""),
            ("(chekd kitchen)", "", "INVALID", "problem.pddl:"),
            ("(checked kitchen)", self.script("echo No plan found in 8 happenings"), "NO_PLAN", "8 happen"),
            ("(checked kitchen)", self.script("kill -SEGV $$"), "CRASHED", "signal 11"),
            ("(checked kitchen)", "timeout 0.2 " + self.script("sleep 60"), "TIMEOUT", "0.2 s"),
            ("(checked kitchen)", self.script("echo '0.0: (ask kitchen) [5.0]'"), "INVALID", "not valid"),
            ("(checked kitchen)", "popf 'DOMAIN PROBLEM", "CRASHED", "closing quotation"),
        ):
            with named_case(state, part):
                self.setUp()
                self.assertFalse(self.plan(goal, command))
                reason = self.status(getattr(PlannerStatus, state)).reason
                self.assertTrue(reason)
                self.assertIn(part, reason)
                sent = self.action.send(self.goal(goal, command))
                self.assertTrue(sent.wait(LONG))
                self.assertEqual((sent.status, sent.result.result_status), (GoalStatus.ABORTED, state))
                self.assertIn(part, sent.text)
                self.assertEqual(self.plans, [])

    def test_cancelling_the_action_kills_the_planner_at_once(self):
        fifo = os.path.join(self.folder.name, "started")
        os.mkfifo(fifo)
        command = self.script(f"trap '' TERM INT\necho $$ > {fifo}\nsleep 1000 & wait\n")
        sent = self.action.send(self.goal(command=command))
        with open(fifo) as file:
            pid = int(file.read())
        self.assertEqual(self.status(PlannerStatus.RUNNING).reason[:8], "planning")
        sent.cancel()
        self.assertTrue(sent.wait(LONG))
        self.assertEqual((sent.status, sent.result.result_status), (GoalStatus.PREEMPTED, "CANCELLED"))
        self.assertTrue(gone(pid))
        self.assertTrue(self.plan("(checked kitchen)"))  # and the next one plans

    def test_a_newer_goal_takes_the_place_of_the_older_one(self):
        fifo = os.path.join(self.folder.name, "running")
        os.mkfifo(fifo)
        first = self.action.send(self.goal(command=self.script(f"echo x > {fifo}\nsleep 1000\n")))
        with open(fifo) as file:
            file.read()
        second = self.action.send(self.goal())
        self.assertTrue(first.wait(LONG) and second.wait(LONG))
        self.assertEqual((first.status, second.status), (GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED))

    def test_the_plain_service_uses_the_parameters_and_the_problem_topic(self):
        rospy.set_param(f"{NODE}/use_problem_topic", True)
        self.problem_topic.publish(String(Path(self.problem("(checked bathroom)")).read_text()))
        end = time.monotonic() + LONG
        with self.changed:
            # The problem travels beside the request, and the plan of the test before may still be on its way.
            while not any("(ask bathroom)" in plan for plan in self.plans):
                self.assertLess(time.monotonic(), end, self.plans)
                self.plain()
                self.changed.wait(1.0)

    def test_a_request_without_files_is_refused_with_a_reason(self):
        rospy.set_param(f"{NODE}/use_problem_topic", False)
        with self.assertRaises(ServiceError) as caught:
            self.plain()
        self.assertIn("problem_path is empty", str(caught.exception))

    def test_a_problem_that_cannot_be_written_names_the_planner_interface_and_the_file(self):
        self.problem_topic.publish(String(Path(self.problem("(checked bathroom)")).read_text()))
        end = time.monotonic() + LONG
        reason = "no problem was received"
        while "no problem was received" in reason:  # it travels beside the request
            self.assertLess(time.monotonic(), end, reason)
            with self.changed:
                self.statuses.clear()
            self.assertFalse(self.params(self.domain, "/gone/problem.pddl", "", "", True).plan_found)
            reason = self.status(PlannerStatus.INVALID).reason
        folder = Path(self.folder.name) / "folder"
        folder.mkdir()
        self.assertFalse(self.params(self.domain, str(folder), "", "", True).plan_found)
        self.assertEqual([path for path in folder.parent.iterdir() if path.name.startswith(".")], [])
        self.assertIn(NODE, reason)
        self.assertIn("cannot write the problem to /gone/problem.pddl: No such file", reason)
