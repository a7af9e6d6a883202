#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""Questions about plans while one is carried out: each answer is right, and the robot's plan goes on."""

import os
import subprocess
import tempfile
import time
import unittest

import rospy
from merlin_msgs.msg import DispatchStatus
from merlin_msgs.srv import Explain, ExplainRequest

import rostest
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.topic_links import init_node, patient_service

GOALS = ["(checked kitchen)", "(checked bathroom)"]


class Explained(unittest.TestCase):
    """A request of two goals whose first drive lasts as long as the test."""

    @classmethod
    def setUpClass(cls):
        cls.ask = patient_service("merlin/explain", Explain, timeout=LONG)
        client = MerlinExecutorClient()
        assert client.wait_for_executor(LONG), "no executor"
        cls.early = cls.ask(question=ExplainRequest.WHY, about="(checked kitchen)")
        cls.request = client.send(GOALS, priority=2)
        cls.plan = []
        status = rospy.wait_for_message("rosplan_plan_dispatcher/dispatch_status", DispatchStatus, LONG)
        while not status.running:
            assert not cls.request.wait(0.0), cls.request.result
            status = rospy.wait_for_message("rosplan_plan_dispatcher/dispatch_status", DispatchStatus, LONG)
        action = status.running[0]
        cls.running = f"({' '.join([action.name, *(each.value for each in action.parameters)])})"

    @classmethod
    def tearDownClass(cls):
        cls.request.cancel()
        cls.request.wait(LONG)

    def tearDown(self):
        status = rospy.wait_for_message("rosplan_plan_dispatcher/dispatch_status", DispatchStatus, LONG)
        self.assertEqual(
            (status.state, len(status.running)), (DispatchStatus.RUNNING, 1), "a question moved it"
        )

    def answer(self, question, words="", kinds=(), **fields):
        """The answer with words and claims that planning finds: it may have no time on a busy machine."""
        end = time.monotonic() + LONG
        while True:
            answer = self.ask(question=question, **fields)
            known = {claim.kind for claim in answer.claims}.issuperset(kinds)
            if answer.ok and words in answer.sentence and known:
                break
            self.assertLess(time.monotonic(), end, answer)
            rospy.rostime.wallsleep(0.1)  # questions without a pause would starve what answers them
        self.assertTrue(answer.claims and all(claim.text for claim in answer.claims), answer)
        return answer

    def why(self, *words):
        with tempfile.TemporaryDirectory() as home:  # with notes of no other run
            return subprocess.run(
                [node_path("merlin", "why"), *words],
                env={**os.environ, "ROS_HOME": home},
                capture_output=True,
                text=True,
                timeout=LONG,
                check=False,
            )

    def test_before_a_plan_there_is_none_to_ask_about(self):
        self.assertFalse(self.early.ok)
        self.assertIn("no plan was made yet", self.early.sentence)

    def test_why_a_step(self):
        answer = self.answer(ExplainRequest.WHY, about=self.running)
        first = answer.claims[0]
        self.assertIn("runs now", first.text)
        kinds = {claim.kind for claim in answer.claims}
        self.assertLessEqual({"step", "link", "request"}, kinds)
        link = next(claim for claim in answer.claims if claim.kind == "link")
        self.assertEqual([each.kind for each in link.evidence], ["step", "step", "fact"])
        self.assertIn("priority 2", answer.sentence)

    def test_why_what_runs(self):
        """A question that names nothing is about the step that runs."""
        whole = self.answer(ExplainRequest.WHY, about=self.running)
        self.assertEqual(self.answer(ExplainRequest.WHY).sentence, whole.sentence)

    def test_why_a_goal(self):
        answer = self.answer(ExplainRequest.WHY, about=GOALS[0])
        self.assertIn(f"{rospy.get_name()} asked for", answer.sentence)
        self.assertEqual({claim.kind for claim in answer.claims}, {"request", "achieved"})

    def test_why_not(self):
        there = f"(navigate {self.running.strip('()').split()[2]} main_door)"
        other = self.answer(ExplainRequest.WHY_NOT, "would be worse", include=[there])
        self.assertIn(there, other.claims[1].evidence[0].text)
        self.answer(ExplainRequest.WHY_NOT, "There is no plan without", without=["(ask kitchen)"])
        goal = next(goal for goal in GOALS if self.running.strip("()").split()[2] not in goal)
        self.answer(ExplainRequest.WHY_NOT, first=[goal])

    def test_no_plan(self):
        kinds, goals = ["impossible", "enough"], ["(robot_at anywhere)"]
        answer = self.answer(ExplainRequest.NO_PLAN, "There is no plan", kinds, goals=goals)
        self.assertEqual([claim.kind for claim in answer.claims], kinds)
        self.answer(ExplainRequest.NO_PLAN, "There is a plan", goals=GOALS)

    def test_what_if(self):
        self.answer(ExplainRequest.WHAT_IF, "instead of", facts=["(checked kitchen)"])
        both = ["(checked kitchen)", "(checked bathroom)"]
        self.answer(ExplainRequest.WHAT_IF, "nothing would have to be done", facts=both)
        self.answer(ExplainRequest.WHAT_IF, goals=["(checked main_door)"])

    def test_a_wrong_question_is_refused(self):
        for fields in (
            {"question": "whither"},
            {"question": ExplainRequest.WHY, "about": "(navigate"},
            {"question": ExplainRequest.WHY, "about": "(fly kitchen)"},
            {"question": ExplainRequest.WHY, "about": "(ask main_door)"},
            {"question": ExplainRequest.WHY, "about": self.running, "at": rospy.Time(1)},
            {"question": ExplainRequest.WHY, "about": "x" * 5000},
            {"question": ExplainRequest.WHY_NOT},
            {"question": ExplainRequest.WHY_NOT, "include": ["(ask moon)"]},
            {"question": ExplainRequest.WHAT_IF, "facts": ["(checked"]},
            {"question": ExplainRequest.WHAT_IF, "facts": ["(> 3 2)"]},
            {"question": ExplainRequest.NO_PLAN, "goals": ["(chekd kitchen)"]},
        ):
            answer = self.ask(**fields)
            self.assertFalse(answer.ok, (fields, answer.sentence))
            self.assertTrue(answer.sentence and "Error" not in answer.sentence, (fields, answer.sentence))
            self.assertLess(len(answer.sentence), 600)

    def test_the_command(self):
        asked = self.why(self.running, "--evidence")
        self.assertEqual((asked.returncode, asked.stderr), (0, ""), asked)
        self.assertIn("Step 1, ", asked.stdout)
        self.assertIn("step: " + self.running, asked.stdout)
        for words in (
            ["--not", "(navigate kitchen main_door)"],
            ["--no-plan"],
            ["--what-if", "(checked kitchen)"],
        ):
            end = time.monotonic() + LONG
            while (answered := self.why(*words)).returncode:
                self.assertLess(time.monotonic(), end, (words, answered))
                rospy.rostime.wallsleep(0.1)
        for words in (
            ["(fly kitchen)"],
            [],
            ["--no-plan", "--what-if", "(checked kitchen)"],
            ["x"],
            ["x", "--at", "soon"],
        ):
            wrong = self.why(*words)
            self.assertEqual((wrong.returncode, wrong.stdout), (2, ""), (words, wrong))
            self.assertEqual(len(wrong.stderr.strip().splitlines()), 1, (words, wrong.stderr))


if __name__ == "__main__":
    init_node("explain_plans_test")
    rostest.rosrun("merlin_test", "explain_plans", Explained)
