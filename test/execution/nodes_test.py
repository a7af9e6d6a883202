#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A part of the conformance cases with the nodes of a launch file, judged by their topics."""

import itertools
import tempfile
import threading
import unittest

import rospy
from merlin_msgs.msg import DispatchStatus, KnowledgeChanges
from node_world import FastClock
from rosplan_dispatch_msgs.srv import DispatchService, ParsingService
from rosplan_knowledge_msgs.msg import DomainFormula

import rostest
from merlin_planning.knowledge_client import ADD, REMOVE, Update, fact, function_value, knowledge_client
from merlin_test import LONG
from merlin_test.topic_links import init_node, patient_service, wait_for_publishers

KB = "/rosplan_knowledge_base"
OPERATORS = {"burn", "mend", "double", "note"}


class Nodes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.clock = FastClock()
        cls.clock.factor = 4.0
        cls.knowledge = knowledge_client(KB)
        cls.parse = patient_service("/rosplan_parsing_interface/parse_plan_from_file", ParsingService)
        cls.dispatch = patient_service("/rosplan_plan_dispatcher/dispatch_plan", DispatchService)
        cls.changed = threading.Condition()
        cls.history, cls.statuses, cls.announced = [], [], set()
        cls.marks, cls.noted = itertools.count(1000), 0.0
        cls.subscribers = [
            rospy.Subscriber(f"{KB}/changes", KnowledgeChanges, cls.note),
            rospy.Subscriber("/rosplan_plan_dispatcher/dispatch_status", DispatchStatus, cls.tell),
            rospy.Subscriber(f"{KB}/pddl_action_parameters", DomainFormula, cls.meet),
        ]
        assert cls.dispatch.wait(LONG) and cls.parse.wait(LONG) and cls.knowledge.wait(LONG)
        wait_for_publishers(*cls.subscribers)  # what is sent before is never heard
        with cls.changed:  # the plans' times leave no room for an interface that has not started
            assert cls.changed.wait_for(lambda: cls.announced >= OPERATORS, LONG), cls.announced

    @classmethod
    def tearDownClass(cls):
        cls.clock.stop()

    @classmethod
    def meet(cls, message):
        with cls.changed:
            cls.announced.add(message.name)
            cls.changed.notify_all()

    @classmethod
    def note(cls, message):
        with cls.changed:
            for sign, items in (("+", message.added), ("-", message.removed), ("=", message.changed)):
                for item in items:
                    values = " ".join([item.attribute_name, *(value.value for value in item.values)])
                    cls.history.append(f"{sign}{values}")
                    cls.noted = item.function_value if values == "noted" else cls.noted
            cls.changed.notify_all()

    @classmethod
    def tell(cls, message):
        with cls.changed:
            cls.statuses.append(message)
            cls.changed.notify_all()

    def setUp(self):
        self.knowledge.update(
            [Update(ADD, fact("unused", match)) for match in ("m1", "m2")]
            + [Update(ADD, fact("free")), Update(REMOVE, fact("mended", "")), Update(REMOVE, fact("told"))]
            + [Update(ADD, function_value("power", [], 3.0))]
        )
        for mark in (next(self.marks), 0):  # all earlier messages have come then
            self.knowledge.update([Update(ADD, function_value("noted", [], float(mark)))])
            with self.changed:
                self.assertTrue(self.changed.wait_for(lambda mark=mark: self.noted == mark, LONG), mark)
        with self.changed:
            self.history.clear()
            self.statuses.clear()

    def give(self, *lines):
        with tempfile.NamedTemporaryFile("w", suffix=".plan") as file:
            file.write("".join(f"{line}\n" for line in lines))
            file.flush()
            return self.parse(plan_path=file.name).plan_parsed

    def run_plan(self, *lines):
        """Runs a plan; the matches go out when all else is done."""
        others = sum("burn" not in line for line in lines)
        answers = []
        self.assertTrue(self.give(*lines))
        thread = threading.Thread(target=lambda: answers.append(self.dispatch()), daemon=True)
        thread.start()
        with self.changed:
            done = self.changed.wait_for(
                lambda: any(each.steps_done == others for each in self.statuses), LONG
            )
        self.assertTrue(done, self.statuses[-1:])
        self.clock.jump(2000.0)
        thread.join(LONG)
        return answers[0]

    def test_texts_that_make_no_plan_are_refused_and_the_parser_lives(self):
        for line in (
            "0: (burn m9) [4]",
            "1e300: (burn m1) [4]",
            "0: (burn m1) [-4]",
            "nan: (burn m1) [4]",
            "?",
        ):
            self.assertFalse(self.give(line), line)
        self.assertTrue(self.give("0: (burn m1) [4]"))

    def test_matches_are_lit_when_they_are_needed(self):
        answer = self.run_plan(
            "0.000: (burn m1) [4.000]",
            "0.001: (mend f1 m1) [2.500]",
            "0.502: (burn m2) [4.000]",
            "2.502: (mend f2 m2) [1.900]",
            "0.000: (double) [0.001]",
            "0.002: (note) [0.001]",
        )
        self.assertTrue(answer.success and answer.goal_achieved, self.statuses[-1:])
        told = {"+mended f1", "+mended f2", "+light m2", "-light m2", "=power", "=noted"}
        with self.changed:
            self.assertTrue(self.changed.wait_for(lambda: told <= set(self.history), LONG), self.history)
            order = {change: index for index, change in enumerate(self.history)}
        self.assertLess(order["+mended f1"], order["+light m2"], self.history)
        self.assertLess(order["+mended f2"], order["-light m2"], self.history)
        self.assertEqual(
            [change for change in self.history if change in ("=power", "=noted")], ["=power", "=noted"]
        )

    def test_plain_actions_that_take_their_time_do_not_overlap(self):
        answer = self.run_plan("0.000: (double) [0.001]", "0.001: (note) [0.001]")
        self.assertTrue(answer.success, self.statuses[-1:])
        self.assertEqual([item.function_value for item in self.knowledge.functions("noted")], [6.0])

    def test_a_goal_that_does_not_hold_is_named(self):
        answer = self.run_plan("0.000: (burn m1) [4.000]", "0.001: (mend f1 m1) [2.500]")
        self.assertTrue(answer.success and not answer.goal_achieved, self.statuses[-1:])
        with self.changed:
            told = self.changed.wait_for(
                lambda: self.statuses and "(mended f2)" in self.statuses[-1].reason, LONG
            )
        self.assertTrue(told, self.statuses[-1:])


if __name__ == "__main__":
    init_node("nodes_test")
    rostest.rosrun("merlin_test", "nodes", "__main__")
