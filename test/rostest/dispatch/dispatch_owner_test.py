# SPDX-License-Identifier: Apache-2.0
"""A dispatch has an owner: what becomes of it when that one hangs or dies, and of actions not answered."""

import signal
import subprocess
import threading
import time
import unittest
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import KeyValue
from dispatch_fixture import KNOWLEDGE_BASE, DispatchFixture, named
from merlin_msgs.msg import Lease
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest, ListExecutions
from rosplan_dispatch_msgs.msg import ActionDispatch, NonBlockingDispatchGoal

from merlin_planning.knowledge_client import fact
from merlin_ros.actions.lease_holder import LeaseHolder
from merlin_test import LONG
from merlin_test.node_path import lean_script
from merlin_test.process_signals import hang
from merlin_test.topic_links import patient_service, sends

VICTIM = Path(__file__).with_name("victim_owner.py")


class Leases:
    """What a node says of the goals that it holds."""

    def __init__(self, topic):
        self.changed = threading.Condition()
        self.heard = []
        self.subscriber = rospy.Subscriber(topic, Lease, self.receive, tcp_nodelay=True)

    def receive(self, lease):
        with self.changed:
            self.heard.append(lease)
            self.changed.notify_all()

    def wait(self, predicate):
        with self.changed:
            assert self.changed.wait_for(lambda: self.heard and predicate(self.heard[-1]), LONG)

    def forget(self):
        with self.changed:
            self.heard.clear()

    def has_heard(self, predicate):
        """Waits for a word that came since :meth:`forget`: some last for moments only."""
        with self.changed:
            assert self.changed.wait_for(lambda: any(map(predicate, self.heard)), LONG), self.heard[-3:]

    def wait_renewed(self):
        """Waits until a goal is held that is renewed, and the dispatcher gets what is said of it."""
        with self.changed:
            assert self.changed.wait_for(lambda: self.heard and self.heard[-1].held, LONG)
            owner = self.heard[-1].owner
        while not sends(owner, self.subscriber.resolved_name, "/planning_system"):
            time.sleep(0.01)
        with self.changed:
            self.heard.clear()
            assert self.changed.wait_for(lambda: sum(1 for lease in self.heard if lease.held) > 1, LONG)


class Owners(DispatchFixture):
    """A dispatcher of the workshop, and clients in processes of their own."""

    def setUp(self):
        super().setUp()
        self.leases, self.owners = [
            Leases(f"{self.dispatcher}/{topic}") for topic in ("lease", "dispatch_plan_action/lease")
        ]
        for leases in (self.leases, self.owners):
            self.addCleanup(leases.subscriber.unregister)
        self.interfaces.answers.update({"paint": [(1,)], "on_cancel": (10, "cancelled")})

    def owner(self, *words):
        """A client that has the plan dispatched; returns when the first action runs."""
        process = subprocess.Popen(
            lean_script(VICTIM, self.dispatcher, *words), stdout=subprocess.PIPE, text=True
        )
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        self.assertEqual(process.stdout.readline(), "begins\n")
        self.interfaces.wait(named("paint"))
        return process

    def two_steps(self):
        self.give("0.0: (paint ann leg) [5.0]", "5.0: (paint bob seat) [5.0]")


class Owner(Owners, unittest.TestCase):
    """The owner of a dispatch, and another one's clients."""

    kind = "simple"

    def test_a_dispatch_whose_owner_dies_is_cancelled(self):
        self.two_steps()
        owner = self.owner()
        action = self.interfaces.wait(named("paint"))
        goal = f"{action.plan_id}/{action.action_id}"
        self.leases.wait(lambda lease: goal in lease.held and goal not in lease.suspended)
        self.owners.wait_renewed()
        self.leases.forget()
        owner.kill()
        self.leases.has_heard(lambda lease: goal in lease.suspended)
        self.interfaces.wait(named("cancel_action"))
        status = self.last_status()
        self.assertRegex(status.reason, "its client /victim_owner_[0-9_]+ is gone")
        self.assertEqual(self.interfaces.names().count("paint"), 1)
        self.leases.wait(lambda lease: not lease.held)

    def test_a_dispatch_whose_owner_hangs_waits_and_goes_on(self):
        self.two_steps()
        owner = self.owner()
        self.leases.wait(lambda lease: lease.held and not lease.suspended)
        self.owners.wait_renewed()
        self.leases.forget()
        hang(owner.pid)
        self.leases.has_heard(lambda lease: lease.suspended == lease.held != [])
        first = self.interfaces.wait(named("paint"))
        self.interfaces.answer(first, 2)
        self.leases.wait(lambda lease: f"{first.plan_id}/{first.action_id}" not in lease.held)
        self.assertEqual(self.interfaces.names(), ["paint"])
        owner.send_signal(signal.SIGCONT)
        second = self.interfaces.wait(named("paint"), count=2)
        self.interfaces.answer(second, 2)
        self.assertEqual(self.last_status().steps_done, 2)

    def test_a_client_that_leases_nothing_and_dies_is_in_nobodys_way(self):
        self.give("0.0: (paint ann leg) [5.0]")
        owner = self.owner("--plain")
        with self.assertRaisesRegex(Exception, "dispatched already, for /victim_owner"):
            self.dispatch()
        owner.kill()
        owner.wait()
        self.give("0.0: (paint bob leg) [5.0]")
        self.interfaces.answers["paint"] = [(1,), (2,)]
        self.assertTrue(self.dispatch().success)
        cancelled = self.interfaces.names()
        self.assertEqual(cancelled[:2], ["paint", "cancel_action"])

    def test_a_goal_takes_the_place_of_a_dispatch_whose_client_has_died(self):
        self.give("0.0: (paint ann leg) [5.0]")
        owner = self.owner("--plain")
        refused = self.action.send(NonBlockingDispatchGoal())
        self.assertTrue(refused.wait(LONG))
        self.assertEqual(refused.status, GoalStatus.REJECTED)
        self.assertIn("dispatched already, for /victim_owner", refused.text)
        owner.kill()
        owner.wait()
        self.give("0.0: (paint bob leg) [5.0]")
        self.interfaces.answers["paint"] = [(1,), (2,)]
        goal = self.action.send(NonBlockingDispatchGoal())
        self.assertTrue(goal.wait(LONG))
        self.assertEqual(goal.status, GoalStatus.SUCCEEDED, goal.text)

    def test_clients_one_after_the_other(self):
        self.interfaces.answers["paint"] = [(1,), (2,)]
        for _ in range(3):
            self.two_steps()
            self.forget_statuses()
            owner = self.owner()
            self.assertEqual(owner.wait(LONG), 0)
            self.assertEqual(self.last_status().steps_done, 2)

    def test_a_goal_whose_client_dies_is_cancelled(self):
        self.two_steps()
        told = threading.Event()
        goal = self.action.send(
            NonBlockingDispatchGoal(),
            on_feedback=lambda _, feedback: feedback.feedback.status == 1 and told.set(),
        )
        self.assertTrue(told.wait(LONG))
        self.leases.wait(lambda lease: lease.held and not lease.suspended)
        lease = LeaseHolder(f"{self.action.name}/lease")  # one that its process shares
        lease.release(goal.id)  # as if it had forgotten it
        self.addCleanup(lease.shutdown)
        self.interfaces.wait(named("cancel_action"))
        self.assertIn("its owner is gone: ", self.last_status().reason)

    def test_nothing_is_latched_by_a_dispatcher_that_has_just_started(self):
        first = rospy.wait_for_message("/fresh_dispatcher/action_dispatch", ActionDispatch, LONG)
        self.assertEqual((first.name, first.action_id), ("cancel_action", -1))


class Unanswered(Owners):
    """Actions whose cancel is not answered."""

    def apply_effects(self, action, phase):
        apply = patient_service(f"{KNOWLEDGE_BASE}/apply_effects", ApplyEffects)
        answer = apply(
            operator_name="paint",
            parameters=[KeyValue("r", "ann"), KeyValue("x", "leg")],
            phase=phase,
            token=f"{action.plan_id}/{action.action_id}/{self.kind}/1",  # dispatchers number alike
            owner="/a_bridge",
            if_interrupted=["(broken ann)"],
        )
        self.assertTrue(answer.success, answer.message)

    def begin(self):
        """A dispatch whose first action is under way; returns it, and what waits for the dispatch's end."""
        del self.interfaces.answers["on_cancel"]
        self.two_steps()
        result = self.start()
        action = self.interfaces.wait(named("paint"))
        self.apply_effects(action, ApplyEffectsRequest.START)
        return action, result

    def executions(self):
        return patient_service(f"{KNOWLEDGE_BASE}/executions", ListExecutions)(owner="").executions


class Patient(Unanswered, unittest.TestCase):
    """An owner that hangs for good, and an interface that lives and does not answer."""

    kind = "patient_simple"

    def test_a_dispatch_whose_owner_hangs_for_good_is_cancelled(self):
        self.two_steps()
        owner = self.owner()
        self.owners.wait_renewed()
        hang(owner.pid)
        self.interfaces.wait(named("cancel_action"))
        self.assertIn("is gone: its client", self.last_status().reason)

    def test_actions_that_do_not_answer_the_cancel_are_named(self):
        action, result = self.begin()
        self.addCleanup(self.apply_effects, action, ApplyEffectsRequest.INTERRUPT)
        self.cancel()
        self.assertFalse(result().success)
        self.assertEqual(self.last_status().unanswered, ["(paint ann leg)"])
        self.assertEqual(len(self.executions()), 1)  # its interface lives and may still close it


class Limits(Unanswered, unittest.TestCase):
    """Interfaces that die."""

    kind = "strict"

    def settled(self):
        """Waits for the knowledge that the settling changes."""
        until = time.monotonic() + LONG
        while self.executions():
            self.assertLess(time.monotonic(), until)
            time.sleep(0.05)
        return self.knowledge.query([fact("broken", "ann")]) == [True]

    def test_an_execution_of_a_dead_interface_is_settled(self):
        _, result = self.begin()
        self.interfaces.announced.clear()
        self.assertFalse(result().success)
        self.assertIn("the action interface of paint is gone", self.last_status().reason)
        self.assertTrue(self.settled())

    def test_an_execution_whose_interface_dies_after_the_cancel_is_settled(self):
        _, result = self.begin()
        self.cancel()
        self.assertFalse(result().success)
        self.interfaces.announced.clear()
        self.assertTrue(self.settled())
