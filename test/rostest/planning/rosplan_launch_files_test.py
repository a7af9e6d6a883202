#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""ROSPlan's usual sequence of service calls, as a script of its users makes them."""

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

import rostest
from merlin_test.topic_links import init_node

LONG = 60.0


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

    def until_published(self, service, topic, message_class):
        arrived = threading.Event()
        messages = []
        name = service.rsplit("/", 1)[0] + "/" + topic
        subscriber = rospy.Subscriber(name, message_class, lambda m: (messages.append(m), arrived.set()))
        end = time.monotonic() + LONG
        while not arrived.wait(0.2):
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

    def test_goal_becomes_true(self):
        self.until_announced("navigate", "ask")
        goal = KnowledgeItem(
            knowledge_type=KnowledgeItem.FACT, attribute_name="checked", values=[KeyValue("p", "kitchen")]
        )
        added = self.call("/rosplan_knowledge_base/update", KnowledgeUpdateService, 1, goal)
        self.assertTrue(added.success)
        self.call("/rosplan_problem_interface/problem_generation_server", Empty)
        problem = self.latched("/rosplan_problem_interface/problem_instance", String).data
        self.assertIn("(checked kitchen)", problem)
        # Each stage hands over by a topic: a client that calls the next one at once has to retry.
        self.until_answered("/rosplan_planner_interface/planning_server", Empty)
        plan = self.latched("/rosplan_planner_interface/planner_output", String).data
        self.assertIn("(navigate anywhere kitchen)", plan)
        graph = self.until_published("/rosplan_parsing_interface/parse_plan", "complete_plan", EsterelPlan)
        self.assertEqual([node.name for node in graph.nodes][0], "plan_start")
        done = self.until_answered(
            "/rosplan_plan_dispatcher/dispatch_plan", DispatchService, lambda answer: answer.goal_achieved
        )
        self.assertTrue(done.success)
        facts = self.call("/rosplan_knowledge_base/state/propositions", GetAttributeService, "").attributes
        texts = {(fact.attribute_name, *[pair.value for pair in fact.values]) for fact in facts}
        self.assertEqual(texts, {("in_service",), ("robot_at", "kitchen"), ("checked", "kitchen")})


if __name__ == "__main__":
    init_node("rosplan_launch_files_test")
    rostest.rosrun("merlin_test", "rosplan_launch_files", RosplanLaunchFilesTest)
