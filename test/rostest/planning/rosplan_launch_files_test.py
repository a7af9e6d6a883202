# SPDX-License-Identifier: Apache-2.0
"""ROSPlan's usual sequence of service calls, as a script of its users makes them."""

import contextlib
import threading
import time
import unittest

import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import EsterelPlan
from rosplan_dispatch_msgs.srv import DispatchService
from rosplan_knowledge_msgs.msg import DomainFormula, KnowledgeItem
from rosplan_knowledge_msgs.srv import GetAttributeService, KnowledgeUpdateService
from std_msgs.msg import String
from std_srvs.srv import Empty

from merlin_test import LONG


class RosplanLaunchFilesTest(unittest.TestCase):
    def call(self, name, service_class, *args):
        rospy.wait_for_service(name, LONG)
        return rospy.ServiceProxy(name, service_class)(*args)

    def latched(self, topic, message_class):
        return rospy.wait_for_message(topic, message_class, LONG)

    def until_answered(self, name, service_class, accept=lambda answer: True):
        end = time.monotonic() + LONG
        while True:
            try:
                answer = self.call(name, service_class)
                if accept(answer):
                    return answer
            except rospy.ServiceException as error:
                answer = error
            self.assertLess(time.monotonic(), end, answer)

    def until_published(self, service, topic, message_class, accept):
        """Calls a stage until it publishes what is wanted; the first message may be one of another test.

        Each stage hands over by a topic: a client that calls the next one at once has to retry.
        """
        arrived = threading.Event()
        messages = []

        def hear(message):
            if accept(message):
                messages.append(message)
                arrived.set()

        name = service.rsplit("/", 1)[0] + "/" + topic
        subscriber = rospy.Subscriber(name, message_class, hear)
        end = time.monotonic() + LONG
        while not arrived.wait(0.2):
            with contextlib.suppress(rospy.ServiceException):
                self.call(service, Empty)
            self.assertLess(time.monotonic(), end, name)
        subscriber.unregister()
        return messages[0]

    def until_announced(self, *operators):
        """An interface takes for old what it gets as it is connected; after that it announces itself."""
        left, arrived = set(operators), threading.Event()

        def hear(formula):
            left.discard(formula.name)
            if not left:
                arrived.set()

        announcements = rospy.Subscriber(
            "/rosplan_knowledge_base/pddl_action_parameters", DomainFormula, hear
        )
        self.assertTrue(arrived.wait(LONG), left)
        announcements.unregister()

    def update(self, kind, name, *values):
        item = KnowledgeItem(
            knowledge_type=KnowledgeItem.FACT,
            attribute_name=name,
            values=[KeyValue(key, value) for key, value in values],
        )
        self.assertTrue(
            self.call("/rosplan_knowledge_base/update", KnowledgeUpdateService, kind, item).success
        )

    def facts(self):
        facts = self.call("/rosplan_knowledge_base/state/propositions", GetAttributeService, "").attributes
        return {(fact.attribute_name, *[pair.value for pair in fact.values]) for fact in facts}

    def test_goals_become_true(self):
        self.until_announced("navigate", "ask")
        self.update(3, "")  # all goals are removed, and these facts
        self.update(2, "checked", ("p", ""))
        self.update(2, "robot_at", ("p", ""))
        self.update(0, "robot_at", ("p", "anywhere"))
        for place in ("kitchen", "dorm_room"):
            self.update(1, "checked", ("p", place))
        self.call("/rosplan_problem_interface/problem_generation_server", Empty)
        problem = self.latched("/rosplan_problem_interface/problem_instance", String).data
        self.assertIn("(checked kitchen)", problem)
        self.assertIn("(checked dorm_room)", problem)
        asks = {"(ask kitchen)", "(ask dorm_room)"}
        plan = self.until_published(
            "/rosplan_planner_interface/planning_server",
            "planner_output",
            String,
            lambda message: all(ask in message.data for ask in asks),
        ).data
        self.assertRegex(plan, r"\(navigate anywhere (kitchen|dorm_room)\)")

        def asked(graph):
            return {node.action.parameters[0].value for node in graph.nodes if node.action.name == "ask"}

        graph = self.until_published(
            "/rosplan_parsing_interface/parse_plan",
            "complete_plan",
            EsterelPlan,
            lambda graph: asked(graph) == {"kitchen", "dorm_room"},
        )
        self.assertEqual([node.name for node in graph.nodes][0], "plan_start")
        done = self.until_answered(
            "/rosplan_plan_dispatcher/dispatch_plan", DispatchService, lambda answer: answer.goal_achieved
        )
        self.assertTrue(done.success)
        places = [("kitchen",), ("dorm_room",)]
        (end,) = {fact[1:] for fact in self.facts() if fact[0] == "robot_at"}
        self.assertIn(end, places)
        self.assertEqual(
            self.facts(), {("in_service",), ("robot_at", *end), *(("checked", *place) for place in places)}
        )
