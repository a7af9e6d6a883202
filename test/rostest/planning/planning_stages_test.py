# SPDX-License-Identifier: Apache-2.0
"""From goals to a finished plan through all stages, called one right after the other without a pause."""

import threading
import unittest

import rospy
from merlin_msgs.msg import DispatchStatus, PlannerStatus
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_dispatch_msgs.srv import DispatchService
from rosplan_knowledge_msgs.msg import DomainFormula, KnowledgeItem
from std_msgs.msg import String
from std_srvs.srv import Empty

from merlin_planning.knowledge_client import (
    ADD,
    ADD_GOAL,
    REMOVE,
    REMOVE_GOAL,
    Update,
    fact,
    knowledge_client,
)
from merlin_ros.service_proxy import ServiceError
from merlin_rosplan.dispatcher.plan_knowledge import PlanKnowledge
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.topic_links import patient_service


class Latched:
    """The last message of a topic."""

    def __init__(self, topic, message_class):
        self._changed = threading.Condition()
        self.messages = []
        self._subscriber = rospy.Subscriber(topic, message_class, self._receive, tcp_nodelay=True)

    def _receive(self, message):
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def wait(self, predicate):
        with self._changed:
            if not self._changed.wait_for(lambda: any(predicate(m) for m in self.messages), LONG):
                raise AssertionError(f"not seen among {self.messages}")
            return next(m for m in reversed(self.messages) if predicate(m))

    def close(self):
        self._subscriber.unregister()


class System:
    """The planning system of one namespace."""

    COMPLETE = set()  # namespaces whose actions were heard of

    def __init__(self, namespace):
        self.namespace = namespace
        self.knowledge = knowledge_client(f"{namespace}/rosplan_knowledge_base")
        names = {
            "problem": ("rosplan_problem_interface/problem_generation_server", Empty),
            "plan": ("rosplan_planner_interface/planning_server", Empty),
            "parse": ("rosplan_parsing_interface/parse_plan", Empty),
            "dispatch": ("rosplan_plan_dispatcher/dispatch_plan", DispatchService),
        }
        for attribute, (name, service) in names.items():
            proxy = patient_service(f"{namespace}/{name}", service, timeout=LONG)
            assert proxy.wait(LONG), proxy.name
            setattr(self, attribute, proxy)
        assert self.knowledge.wait(LONG)
        if namespace not in self.COMPLETE:
            interfaces = self.topic("rosplan_knowledge_base/pddl_action_parameters", DomainFormula)
            for name in ("navigate", "ask"):
                interfaces.wait(lambda formula, name=name: formula.name == name)
            interfaces.close()
            self.COMPLETE.add(namespace)

    def set_goals(self, *goals):
        self.knowledge.update(
            [Update(REMOVE_GOAL, fact("")), *[Update(ADD_GOAL, fact(*goal)) for goal in goals]]
        )

    def topic(self, name, message_class):
        return Latched(f"{self.namespace}/{name}", message_class)


class Stages:
    """What both arrangements do; the namespace says which."""

    namespace: str

    def setUp(self):
        self.system = System(self.namespace)
        self.system.knowledge.update([Update(REMOVE, fact("checked", ""))])

    def run_once(self):
        self.system.problem()
        self.system.plan()
        self.system.parse()
        return self.system.dispatch()

    def test_goals_come_true_and_each_request_gets_its_own_plan(self):
        actions = Received(f"{self.namespace}/rosplan_plan_dispatcher/action_dispatch", ActionDispatch)
        self.addCleanup(actions.close)
        for poi in ("kitchen", "bathroom", "main_door", "dorm_room"):
            self.system.set_goals(("checked", poi))
            answer = self.run_once()
            self.assertTrue(answer.success and answer.goal_achieved, poi)
            self.assertEqual(
                self.system.knowledge.query([fact("checked", poi), fact("robot_at", poi)]), [True, True]
            )
        actions.wait(lambda m: m.name == "ask" and m.parameters[0].value == "dorm_room")
        asked = [m.parameters[0].value for m in actions.messages if m.name == "ask"]
        self.assertEqual(asked, ["kitchen", "bathroom", "main_door", "dorm_room"])

    def test_several_goals_in_one_plan(self):
        self.system.set_goals(("checked", "kitchen"), ("checked", "bathroom"), ("checked", "main_door"))
        answer = self.run_once()
        self.assertTrue(answer.success and answer.goal_achieved)

    def test_goals_that_hold_need_no_action(self):
        self.system.knowledge.update([Update(ADD, fact("checked", "kitchen"))])
        self.system.set_goals(("checked", "kitchen"))
        answer = self.run_once()
        self.assertTrue(answer.success and answer.goal_achieved)

    def test_a_plan_is_not_dispatched_twice_by_accident(self):
        status = self.system.topic("rosplan_plan_dispatcher/dispatch_status", DispatchStatus)
        self.addCleanup(status.close)
        self.system.set_goals(("checked", "kitchen"))
        self.assertTrue(self.run_once().success)
        self.system.set_goals(("checked", "bathroom"))
        answer = self.system.dispatch()
        self.assertFalse(answer.success or answer.goal_achieved)
        self.assertIn("dispatched already", status.wait(lambda m: "no new plan" in m.reason).reason)

    def test_an_unsolvable_problem_says_why(self):
        status = self.system.topic("rosplan_planner_interface/planner_status", PlannerStatus)
        self.addCleanup(status.close)
        self.system.set_goals(("robot_at", "kitchen"), ("robot_at", "bathroom"))
        self.system.problem()
        with self.assertRaises(ServiceError) as caught:
            self.system.plan()
        self.assertIn("UNSOLVABLE", str(caught.exception))
        self.assertTrue(status.wait(lambda m: m.state == PlannerStatus.UNSOLVABLE).reason)

    def test_the_dispatcher_knows_what_a_goal_of_another_kind_reads(self):
        text = "(exists (?p - poi) (checked ?p))"
        goal = KnowledgeItem(knowledge_type=KnowledgeItem.EXPRESSION, attribute_name=text)
        self.system.set_goals()
        self.system.knowledge.update([Update(ADD_GOAL, goal)])
        dispatcher = PlanKnowledge(self.system.knowledge.name)
        self.assertIn("checked", dispatcher.goals().reads)
        self.assertEqual(dispatcher.unmet_goals(), [text])

    def test_a_plan_that_cannot_be_read_is_refused_each_time(self):
        output = f"{self.namespace}/rosplan_planner_interface/planner_output"
        planner = rospy.Publisher(output, String, latch=True, queue_size=1)
        planner.publish("0.000: (fly kitchen) [1.000]\n")
        seen = Latched(output, String)
        seen.wait(lambda plan: "fly" in plan.data)
        seen.close()
        for _ in range(2):
            with self.assertRaisesRegex(ServiceError, "fly"):
                self.system.parse()
        planner.unregister()
        self.assertFalse(self.system.dispatch().success)
        self.system.set_goals(("checked", "kitchen"))
        self.assertTrue(self.run_once().success)

    def test_parsing_again_publishes_nothing_and_is_no_error(self):
        self.system.set_goals(("checked", "kitchen"))
        self.run_once()
        self.system.parse()
        self.assertFalse(self.system.dispatch().success)


class Together(Stages, unittest.TestCase):
    namespace = "together"


class Apart(Stages, unittest.TestCase):
    namespace = ""
