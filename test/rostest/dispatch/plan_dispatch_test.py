# SPDX-License-Identifier: Apache-2.0
"""What a plan dispatcher promises to action interfaces and to its callers, over ROS."""

import threading
import time
import unittest

import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import KeyValue
from dispatch_fixture import KNOWLEDGE_BASE, DispatchFixture, Interfaces, named
from merlin_msgs.msg import DispatchStatus
from merlin_msgs.srv import ExchangePlan
from rosplan_dispatch_msgs.msg import (
    ActionDispatch,
    ActionFeedback,
    CompletePlan,
    EsterelPlan,
    NonBlockingDispatchGoal,
)
from rosplan_dispatch_msgs.srv import DispatchService
from rosplan_knowledge_msgs.msg import DomainFormula
from std_msgs.msg import String

from merlin_planning.knowledge_client import (
    ADD,
    ADD_GOAL,
    REMOVE,
    Update,
    fact,
    function_value,
)
from merlin_ros.service_proxy import ServiceError
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.topic_links import patient_service, wait_for_connections


class Expressions(DispatchFixture):
    """Promises about conditions that no message carries."""

    def test_a_disjunction_is_checked(self):
        self.refused("(or (painted leg) (stored leg)) does not hold", "0.0: (inspect ann leg) [5.0]")
        self.knowledge.update([Update(ADD, fact("stored", "leg"))])
        self.give("0.0: (inspect ann leg) [5.0]")
        self.assertTrue(self.dispatch().success)

    def inspection_broken_by(self, update):
        self.knowledge.update([Update(ADD, fact("painted", "leg"))])
        self.interfaces.answers.update({"inspect": [(1,)], "on_cancel": (10, "cancelled")})
        self.give("0.0: (inspect ann leg) [5.0]")
        result = self.start()
        self.interfaces.wait(named("inspect"))
        self.knowledge.update([update])
        self.assertFalse(result().success)
        return self.last_status().reason

    def test_a_quantified_over_all_condition_is_watched(self):
        reason = self.inspection_broken_by(Update(ADD, function_value("battery", ["bob"], 1.0)))
        self.assertIn("(forall (?o - robot) (>= (battery ?o) 5)) does not hold", reason)

    def test_an_over_all_condition_on_a_derived_predicate_is_watched(self):
        reason = self.inspection_broken_by(Update(ADD, fact("broken", "ann")))
        self.assertIn("(lit ann) does not hold", reason)


class Dispatching(Expressions):
    """Promises of both dispatchers."""

    # --- the course of a plan ---

    def test_a_plan_runs_to_its_end_and_one_tombstone_follows(self):
        self.give("0.0: (paint ann leg) [5.0]", "5.0: (paint ann seat) [5.0]")
        answer = self.dispatch()
        self.assertTrue(answer.success)
        stone = self.tombstones()
        last = [m for m in self.interfaces.dispatched if m.name == "paint"][-1]
        self.assertEqual(len(stone), 1)
        self.assertEqual(
            (stone[0].action_id, stone[0].plan_id, stone[0].parameters, stone[0].duration),
            (last.action_id, last.plan_id, last.parameters, last.duration),
        )
        self.assertEqual([(p.key, p.value) for p in last.parameters], [("r", "ann"), ("x", "seat")])
        status = self.last_status()
        self.assertEqual((status.reason, status.goal_achieved, status.unmet_goals), ("", True, []))
        # a subscriber that connects now gets the tombstone and nothing to execute
        late = Interfaces.__new__(Interfaces)
        late.dispatcher, late.changed, late.dispatched, late.answers = "", threading.Condition(), [], {}
        subscriber = rospy.Subscriber(f"{self.dispatcher}/action_dispatch", ActionDispatch, late.receive)
        self.addCleanup(subscriber.unregister)
        self.assertEqual(late.wait(lambda m: True).name, "cancel_action")

    def test_a_goal_that_does_not_hold_is_told_apart_from_a_failed_plan(self):
        self.knowledge.update([Update(ADD_GOAL, fact("painted", "leg"))])
        self.give("0.0: (paint ann leg) [5.0]")
        answer = self.dispatch()  # the interfaces of this test apply no effects
        self.assertTrue(answer.success and not answer.goal_achieved)
        status = self.last_status()
        self.assertIn("(painted leg)", status.reason)
        self.assertEqual((status.goal_achieved, status.unmet_goals), (False, ["(painted leg)"]))

    def test_the_action_server_dispatches_too(self):
        self.give("0.0: (paint ann leg) [5.0]")
        self.interfaces.answers["paint"] = [(1,)]
        told = threading.Event()
        sent = self.action.send(
            NonBlockingDispatchGoal(),
            on_feedback=lambda _, feedback: feedback.feedback.status == 1 and told.set(),
        )
        self.assertTrue(told.wait(LONG))
        self.interfaces.answer(self.interfaces.wait(named("paint")), 2)
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.SUCCEEDED)
        self.assertTrue(sent.result.success and sent.result.goal_achieved)

    def test_a_failed_action_ends_the_dispatch(self):
        self.interfaces.answers["paint"] = [(1,), (10, "the can is empty")]
        self.give("0.0: (paint ann leg) [5.0]", "5.0: (store_part bob leg) [5.0]")
        answer = self.dispatch()
        self.assertFalse(answer.success)
        status = self.last_status()
        self.assertIn("the can is empty", status.reason)
        self.assertEqual(status.failed_action, "(paint ann leg)")
        self.assertNotIn("store_part", self.interfaces.names())

    def test_a_failed_action_aborts_the_goal_with_its_reason(self):
        self.interfaces.answers["paint"] = [(10, "the can is empty")]
        self.give("0.0: (paint ann leg) [5.0]")
        sent = self.action.send(NonBlockingDispatchGoal())
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.ABORTED)
        self.assertIn("the can is empty", sent.text)

    # --- conditions ---

    def test_a_negative_condition_is_checked(self):
        self.knowledge.update([Update(ADD, fact("broken", "ann"))])
        self.refused("(broken ann) holds")

    def test_a_numeric_condition_is_checked(self):
        self.knowledge.update([Update(ADD, function_value("battery", ["ann"], 9.0))])
        self.refused("battery")

    def test_a_positive_condition_with_a_constant_is_checked(self):
        self.knowledge.update([Update(ADD, fact("painted", "leg"))])
        self.refused("(at ann store) does not hold", "0.0: (store_part ann leg) [5.0]")

    def test_equality_is_checked(self):
        self.refused("(= bench bench) holds", "0.0: (move ann bench bench) [5.0]")

    def test_an_over_all_condition_is_checked_before_and_watched_while_the_action_runs(self):
        self.interfaces.answers.update({"paint": [(1,)], "on_cancel": (10, "cancelled")})
        self.give("0.0: (paint ann leg) [5.0]")
        result = self.start()
        self.interfaces.wait(named("paint"))
        self.knowledge.update([Update(REMOVE, fact("powered"))])
        self.assertFalse(result().success)
        self.assertIn("(powered) does not hold", self.last_status().reason)
        self.interfaces.wait(named("cancel_action"), 2)  # the cancel, and the one that ends the dispatch
        self.interfaces.dispatched.clear()
        self.refused("(powered) does not hold")

    # --- cancel ---

    def test_cancel_reaches_the_running_action_and_waits_for_its_answer(self):
        self.interfaces.answers["paint"] = [(1,)]
        self.give("0.0: (paint ann leg) [5.0]", "5.0: (store_part bob leg) [5.0]")
        result = self.start()
        running = self.interfaces.wait(named("paint"))
        self.cancel()
        cancel = self.interfaces.wait(named("cancel_action"))
        self.assertEqual(
            (cancel.action_id, cancel.plan_id, cancel.parameters),
            (running.action_id, running.plan_id, running.parameters),
        )
        self.assertEqual(self.last_status(DispatchStatus.CANCELLING).running[0].action_id, running.action_id)
        self.interfaces.answer(running, 10, "cancelled")
        answer = result()
        self.assertFalse(answer.success)
        self.assertNotIn("no answer", self.last_status().reason)
        self.interfaces.wait(named("cancel_action"), 2)  # the cancel, and the one that ends the dispatch
        self.assertEqual(self.interfaces.names(), ["paint", "cancel_action", "cancel_action"])

    def test_a_cancelled_goal_ends_preempted(self):
        self.interfaces.answers.update({"paint": [(1,)], "on_cancel": (10, "cancelled")})
        self.give("0.0: (paint ann leg) [5.0]")
        sent = self.action.send(NonBlockingDispatchGoal())
        self.interfaces.wait(named("paint"))
        sent.cancel()
        self.assertTrue(sent.wait(LONG))
        self.assertEqual(sent.status, GoalStatus.PREEMPTED)

    def test_a_stray_cancel_does_not_touch_the_next_dispatch(self):
        self.give("0.0: (paint ann leg) [5.0]")
        self.cancel()
        self.assertTrue(self.dispatch().success)
        self.assertIn("paint", self.interfaces.names())

    # --- nonsense ---

    def test_a_second_dispatch_while_one_runs_is_refused(self):
        self.interfaces.answers.update({"paint": [(1,)], "on_cancel": (10, "cancelled")})
        self.give("0.0: (paint ann leg) [5.0]")
        result = self.start()
        self.interfaces.wait(named("paint"))
        with self.assertRaisesRegex(ServiceError, "being dispatched already"):
            patient_service(f"{self.dispatcher}/dispatch_plan", DispatchService)()
        second = self.action.send(NonBlockingDispatchGoal())
        self.assertTrue(second.wait(LONG))
        self.assertEqual(second.status, GoalStatus.REJECTED)
        self.cancel()
        result()

    def test_a_plan_of_another_domain_is_refused_by_the_parser(self):
        self.assertFalse(self.give("0.0: (navigate hall kitchen) [5.0]"))
        self.assertFalse(self.give("0.0: (paint ann) [5.0]"))
        self.assertFalse(self.give("soon: (paint ann leg) [5.0]"))
        self.assertFalse(self.parse(plan_path="/nowhere/plan").plan_parsed)
        self.assertFalse(self.dispatch().success)  # and nothing is left to dispatch

    def test_feedback_that_fits_nothing_is_ignored(self):
        self.interfaces.answers["paint"] = [(1,)]
        self.knowledge.update([Update(ADD, fact("painted", "leg"))])  # the interface applies no effects
        self.give("0.0: (paint ann leg) [5.0]", "5.0: (store_part bob leg) [5.0]")
        result = self.start()
        running = self.interfaces.wait(named("paint"))
        stranger = ActionDispatch(action_id=999, plan_id=running.plan_id)
        for message, status, plan_id in (
            (stranger, 10, None),
            (stranger, 2, None),
            (running, 10, running.plan_id - 1),
            (running, 2, -5),
            (running, 77, None),
            (running, 0, None),
        ):
            self.interfaces.answer(message, status, plan_id=plan_id)
        self.interfaces.answer(running, 2)
        self.assertTrue(result().success)
        self.assertEqual(self.interfaces.names()[:2], ["paint", "store_part"])

    def test_nothing_new_is_nothing_to_dispatch(self):
        self.give("0.0: (paint ann leg) [5.0]")
        self.assertTrue(self.dispatch().success)
        self.assertFalse(self.dispatch().success)
        self.assertEqual(self.interfaces.names().count("paint"), 1)

    def test_interfaces_that_do_not_set_the_plan_id_are_understood(self):
        self.interfaces.answers["paint"] = [(1, "", 0), (2, "", 0)]
        self.give("0.0: (paint ann leg) [5.0]")
        self.assertTrue(self.dispatch().success)


class SimpleDispatching(Dispatching, unittest.TestCase):
    kind = "simple"

    def test_an_action_that_is_dropped_for_another_plan_and_does_not_stop_ends_the_dispatch(self):
        publisher = rospy.Publisher("/simple_parser/complete_plan", CompletePlan, queue_size=1)
        self.addCleanup(publisher.unregister)
        wait_for_connections(publisher)
        exchange = patient_service(f"{self.dispatcher}/exchange_plan", ExchangePlan)
        other = [KeyValue("r", "bob"), KeyValue("x", "seat")]
        self.interfaces.answers["paint"] = [(1,)]
        self.give("0.0: (paint ann leg) [5.0]")
        sent = self.action.send(NonBlockingDispatchGoal())
        self.interfaces.wait(named("paint"))
        publisher.publish(CompletePlan([ActionDispatch(action_id=9, name="paint", parameters=other)]))

        def call():
            while "no new plan" in exchange(goal=sent.id, known=[0]).refused and not sent.wait(0.0):
                pass  # it travels beside the request, which waits for it a moment

        thread = threading.Thread(target=call, daemon=True)
        thread.start()
        stopped = self.interfaces.wait(named("cancel_action"))
        self.interfaces.answer(stopped, 10, "it drives on", stopped="no")
        self.assertTrue(sent.wait(LONG))
        thread.join(LONG)
        self.assertEqual(sent.status, GoalStatus.ABORTED)
        self.assertIn("(paint ann leg) was cancelled and did not stop", sent.text)

    def test_a_list_with_an_unknown_operator_is_refused(self):
        publisher = rospy.Publisher("/simple_parser/complete_plan", CompletePlan, queue_size=1)
        self.addCleanup(publisher.unregister)
        wait_for_connections(publisher)
        for plan in (
            CompletePlan([ActionDispatch(name="fly")]),
            CompletePlan([ActionDispatch(name="paint", parameters=[KeyValue("r", "ann")])]),
            CompletePlan(
                [ActionDispatch(action_id=1, name="paint"), ActionDispatch(action_id=1, name="paint")]
            ),
        ):
            publisher.publish(plan)
            self.assertFalse(self.dispatch().success)
            self.assertNotEqual(self.last_status().reason, "")
        self.assertEqual(self.interfaces.names(), [])


class EsterelDispatching(Dispatching, unittest.TestCase):
    kind = "esterel"

    def test_an_action_waits_for_what_makes_its_disjunction_true(self):
        self.interfaces.answers.update({"paint": [(1,)]})
        self.give("0.0: (paint ann leg) [5.0]", "5.0: (inspect bob leg) [5.0]")
        result = self.start()
        paint = self.interfaces.wait(named("paint"))
        self.knowledge.update([Update(ADD, fact("painted", "leg"))])
        self.interfaces.answer(paint, 2)
        self.assertTrue(result().success)
        self.assertEqual(self.interfaces.names()[:2], ["paint", "inspect"])

    def test_independent_actions_run_at_the_same_time_and_cancel_reaches_only_running_ones(self):
        self.interfaces.answers.update({"paint": [(1,)], "on_cancel": (10, "cancelled")})
        self.give("0.0: (paint ann leg) [5.0]", "0.0: (paint bob seat) [5.0]", "0.0: (paint bob back) [5.0]")
        result = self.start()
        self.interfaces.wait(named("paint"), 3)
        first = self.interfaces.wait(lambda m: m.action_id == 0)
        self.interfaces.answer(first, 2)
        self.last_status(DispatchStatus.RUNNING)
        with self.status_changed:
            self.assertTrue(self.status_changed.wait_for(lambda: self.statuses[-1].steps_done == 1, LONG))
        self.cancel()
        self.assertFalse(result().success)
        self.interfaces.wait(named("cancel_action"), 3)
        cancelled = [m.action_id for m in self.interfaces.dispatched if m.name == "cancel_action"]
        self.assertEqual(sorted(cancelled[:2]), [1, 2])
        self.assertEqual(len(cancelled), 3)

    def test_the_graph_is_drawn(self):
        drawings = []
        drawn = threading.Event()

        def receive(message):
            drawings.append(message.data)
            if "darkolivegreen" in message.data:
                drawn.set()

        subscriber = rospy.Subscriber(f"{self.dispatcher}/plan_graph", String, receive)
        self.addCleanup(subscriber.unregister)
        self.give("0.0: (paint ann leg) [5.0]")
        self.assertTrue(self.dispatch().success)
        self.assertTrue(drawn.wait(LONG))
        self.assertIn('1[ label="paint_start\\n(ann,leg)"', drawings[-1])
        self.assertIn('"1" -> "2" [ label="[5, 5]" , penwidth=2, color=', drawings[-1])

    def test_a_damaged_graph_is_refused(self):
        publisher = rospy.Publisher("/esterel_parser/complete_plan", EsterelPlan, queue_size=1)
        self.addCleanup(publisher.unregister)
        wait_for_connections(publisher)
        self.give("0.0: (paint ann leg) [5.0]")
        plan = rospy.wait_for_message("/esterel_parser/complete_plan", EsterelPlan, LONG)
        self.assertTrue(self.dispatch().success)  # else it may come before the damaged one
        plan.edges[0].sink_ids = [77]
        publisher.publish(plan)
        reason, end = "no new plan", time.monotonic() + LONG
        while "no new plan" in reason:  # it travels beside the request
            self.assertLess(time.monotonic(), end, reason)
            self.forget_statuses()
            self.assertFalse(self.dispatch().success)
            reason = self.last_status().reason
        self.assertIn("joins nodes", reason)


class Patient(DispatchFixture):
    """Interfaces that live, at dispatchers that wait for seconds only until what they cancel has stopped."""

    def test_who_does_not_answer_a_cancel_is_named(self):
        self.interfaces.answers["paint"] = [(1,)]
        self.give("0.0: (paint ann leg) [5.0]")
        result = self.start()
        self.interfaces.wait(named("paint"))
        self.cancel()
        self.assertFalse(result().success)
        self.assertIn("no answer to the cancel from (paint ann leg)", self.last_status().reason)


class PatientSimple(Patient, unittest.TestCase):
    kind = "patient_simple"


class PatientEsterel(Patient, unittest.TestCase):
    kind = "patient_esterel"


class Limits(DispatchFixture):
    """Interfaces that are missing, dead or silent, at dispatchers that wait for seconds only.

    Each case silences another one: a dispatcher has more patience with what it has heard seldom.
    """

    def test_a_missing_interface_is_named_within_seconds(self):
        self.interfaces.announced.discard("move")
        self.interfaces.answers["move"] = []
        watched = rospy.Subscriber(f"{KNOWLEDGE_BASE}/pddl_action_parameters", DomainFormula, lambda m: None)
        self.addCleanup(watched.unregister)
        self.give("0.0: (move ann bench store) [5.0]")
        self.assertFalse(self.dispatch().success)
        self.assertRegex(self.last_status().reason, "no action interface for move|interface of move is gone")

    def test_an_interface_that_dies_in_its_action_is_named(self):
        self.interfaces.answers["paint"] = [(1,)]
        self.give("0.0: (paint ann leg) [5.0]")
        result = self.start()
        self.interfaces.wait(named("paint"))
        self.interfaces.announced.discard("paint")
        self.assertFalse(result().success)
        self.assertIn("interface of paint is gone, silent", self.last_status().reason)


class SimpleLimits(Limits, unittest.TestCase):
    kind = "strict_simple"

    def test_its_own_feedback_is_on_the_wire_and_not_mistaken_for_an_answer(self):
        # The dispatcher publishes, and this test's interfaces.
        seen = Received(f"{self.dispatcher}/action_feedback", ActionFeedback, publishers=2)
        self.addCleanup(seen.close)
        self.interfaces.announced.discard("store_part")
        self.interfaces.answers["store_part"] = []
        self.knowledge.update([Update(ADD, fact("painted", "leg"))])
        self.give("0.0: (store_part bob leg) [5.0]")
        self.assertFalse(self.dispatch().success)
        self.assertRegex(self.last_status().reason, "no action interface|is gone")
        plan_id = self.last_status().plan_id

        def own(message):
            return message.plan_id == plan_id and message.information[0].key == "dispatcher"

        seen.wait(own)
        self.assertEqual([message.status for message in filter(own, seen.messages)], [1])


class EsterelLimits(Limits, unittest.TestCase):
    kind = "strict_esterel"


class DispatchingOfItsOwnProcess(Expressions, unittest.TestCase):
    kind = "outer"
