# SPDX-License-Identifier: Apache-2.0
"""Another plan takes the place of the rest of one that runs, and the robot drives on."""

import contextlib
import os
import tempfile
import threading
import unittest
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalID
from merlin_msgs.msg import DispatchStatus, ExecutorStatus, GoalQueue, PlannerStatus
from merlin_msgs.srv import ExchangePlan
from move_base_msgs.msg import MoveBaseActionGoal
from rosplan_dispatch_msgs.msg import ActionDispatch
from std_msgs.msg import String

from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_planning.dispatch_client import DispatchClient
from merlin_planning.planning_client import Planned, PlanningClient
from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceError
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.held_drives import HeldDrives
from merlin_test.topic_links import patient_service, wait_for_publishers

GOALS = ["(checked kitchen)", "(checked bathroom)"]
HOLDS = "(in_service)"
PLANNER = "rosplan_planner_interface/planner_command"


def text(action):
    return f"({' '.join([action.name, *(entry.value for entry in action.parameters)])})"


class Heard:
    """The messages of a topic from now on."""

    def __init__(self, topic, kind):
        self.messages = []
        self._changed = threading.Condition()
        self._subscriber = rospy.Subscriber(topic, kind, self._receive, tcp_nodelay=True)
        wait_for_publishers(self._subscriber)

    def _receive(self, message):
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def wait(self, fits):
        with self._changed:
            assert self._changed.wait_for(lambda: any(map(fits, self.messages)), LONG), self.messages[-5:]
            return next(filter(fits, self.messages))

    def wait_count(self, count):
        with self._changed:
            assert self._changed.wait_for(lambda: len(self.messages) >= count, LONG), self.messages[-5:]


class Exchange(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.knowledge = MerlinROSPlanAssistant()
        assert cls.knowledge.knowledge.wait(LONG)
        cls.planning = PlanningClient()
        cls.planning.wait(LONG)
        cls.changed = threading.Condition()
        cls.dispatcher = DispatchClient(on_change=cls.notify)
        assert cls.dispatcher.wait_status(LONG) and cls.dispatcher.can_exchange
        cls.held = HeldDrives()
        cls.drives = Heard("move_base/goal", MoveBaseActionGoal)
        cls.cancels = Heard("move_base/cancel", GoalID)
        cls.dispatched = Heard("rosplan_plan_dispatcher/action_dispatch", ActionDispatch)
        cls.status = Heard("rosplan_plan_dispatcher/dispatch_status", DispatchStatus)
        cls.graph = Heard("rosplan_plan_dispatcher/plan_graph", String)
        cls.executor = Heard("merlin/status", ExecutorStatus)
        cls.queue = Heard("merlin/queue", GoalQueue)
        cls.planned = Heard("rosplan_planner_interface/planner_status", PlannerStatus)
        cls.clients = [MerlinExecutorClient(), MerlinExecutorClient()]
        assert all(client.wait_for_executor(LONG) for client in cls.clients)

    @classmethod
    def notify(cls):
        with cls.changed:
            cls.changed.notify_all()

    def setUp(self):
        self.addCleanup(self.knowledge.remove_goals, [*GOALS, HOLDS])
        self.addCleanup(self.held.end)
        self.knowledge.remove_facts([*GOALS, *self.knowledge.facts("robot_at")])
        self.knowledge.add_facts("(robot_at main_door)")
        for heard in (self.drives, self.cancels, self.dispatched, self.status, self.graph, self.executor):
            heard.messages.clear()
        self.planned.messages.clear()
        self.queue.messages.clear()
        self.interrupt = lambda: None
        self.results = []

    def plan(self, goal, after=None):
        self.knowledge.add_goals(goal)
        self.planning.generate_problem()
        result = self.planning.plan(lambda _: None, after=after)
        self.assertIs(result.verdict, Planned.SOLVED, result.reason)
        return self.planning.parse_plan()

    def driving(self):
        """Begins a plan; returns its thread and the drive that runs."""
        self.held.hold()
        plan = self.plan(GOALS[0])

        def interruptible(interrupt):
            self.interrupt = interrupt or self.interrupt

        thread = threading.Thread(
            target=lambda: self.results.append(self.dispatcher.dispatch(interruptible, plan)), daemon=True
        )
        thread.start()
        self.held.wait_driving()
        with self.changed:
            self.assertTrue(self.changed.wait_for(lambda: self.dispatcher.running, LONG))
        (drive,) = self.dispatcher.running
        self.assertEqual(text(drive), "(navigate main_door kitchen)")
        return thread, drive

    def assertDriven(self, count):
        """So many drives, and no cancel; what travels on other topics may come behind the result."""
        self.drives.wait_count(count)
        self.assertEqual((len(self.drives.messages), self.cancels.messages), (count, []))

    def result(self, thread):
        thread.join(LONG)
        self.assertFalse(thread.is_alive(), "the dispatch does not end")
        return self.results[0]

    def exchanged(self, drive):
        """Has the bathroom checked, too, behind a drive that goes on; returns the plan."""
        plan = self.plan(GOALS[1], [text(drive)])
        self.assertNotIn(text(drive), map(text, plan))
        self.assertEqual(self.dispatcher.exchange(plan, [drive]), "")
        return plan

    def test_a_drive_goes_on_and_the_new_steps_follow(self):
        thread, drive = self.driving()
        plan = self.exchanged(drive)
        self.status.wait(lambda status: status.steps_total == len(plan) + 1)
        self.graph.wait(lambda each: "(main_door,kitchen)" in each.data and "(bathroom)" in each.data)
        self.assertEqual(self.cancels.messages, [])
        self.held.end()
        result = self.result(thread)
        self.assertTrue(result.goal_achieved, result.reason)
        self.assertTrue(all(map(self.knowledge.holds, GOALS)))
        self.status.wait(lambda status: status.steps_done == len(plan) + 1)
        self.dispatched.wait(lambda each: text(each) == text(plan[-1]))
        sent = [message for message in self.dispatched.messages if message.name != "cancel_action"]
        self.assertEqual([text(each) for each in sent], [text(drive), *map(text, plan)])
        self.assertEqual({each.plan_id for each in sent}, {drive.plan_id})
        self.assertEqual(len({each.action_id for each in sent}), len(sent))
        self.assertDriven(len([each for each in sent if each.name == "navigate"]))

    def test_a_cancel_behind_the_exchange_stops_the_drive(self):
        thread, drive = self.driving()
        self.exchanged(drive)
        self.interrupt()
        self.held.wait_stopped()
        result = self.result(thread)
        self.assertTrue(result.cancelled and not result.unstopped, result.reason)
        self.assertEqual(self.knowledge.facts("robot_at"), ["(robot_at anywhere)"])

    def test_a_drive_that_is_not_part_of_the_new_plan_stops_before_that_begins(self):
        thread, drive = self.driving()
        self.knowledge.remove_goals(GOALS[0])
        self.assertEqual(self.dispatcher.exchange(self.plan(HOLDS, []), []), "")
        self.held.wait_stopped()
        result = self.result(thread)
        self.assertTrue(result.goal_achieved, result.reason)
        self.drives.wait_count(1)
        self.assertEqual(len(self.drives.messages), 1)

    def test_the_plan_of_another_client_is_left_alone(self):
        thread, drive = self.driving()
        plan = self.plan(GOALS[1], [text(drive)])
        other = DispatchClient()
        self.assertIn("carries out no plan of this node", other.exchange(plan, [drive]))
        exchange = patient_service("rosplan_plan_dispatcher/exchange_plan", ExchangePlan)
        refused = exchange(goal="of another client", keep=[drive.action_id]).refused
        self.assertIn("carries out no plan for this goal", refused)
        self.held.end()
        self.assertEqual(self.result(thread).unmet, (GOALS[1],))
        self.status.wait(lambda status: status.steps_done == 2)

    # --- the Executor, with two clients

    def joined(self):
        """One request, whose drive to the kitchen is held, and one of another client that has joined it."""
        first, second = self.driving_for_one(), self.clients[1].send(GOALS[1])
        self.executor.wait(lambda status: [each.request for each in status.together] == [second.id])
        return first, second

    def driving_for_one(self, **times):
        self.held.hold()
        request = self.clients[0].send(GOALS[0], **times)
        self.held.wait_driving()
        return request

    def assertOutcome(self, request, outcome):
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), outcome, request.result.reason)

    def test_a_newcomer_joins_in_mid_drive_and_the_drive_goes_on(self):
        requests = self.joined()
        self.assertDriven(1)
        self.held.end()
        for request in requests:
            self.assertOutcome(request, "SUCCEEDED")
        self.assertDriven(2)
        self.assertEqual(requests[1].result.replans, 0)
        self.assertEqual(set(self.knowledge.goals()) & set(GOALS), set())

    def test_requests_with_deadlines_join_in_mid_drive(self):
        first = self.driving_for_one(deadline=10 * LONG)
        second = self.clients[1].send(GOALS[1], deadline=20 * LONG)
        status = self.executor.wait(lambda each: [other.request for other in each.together] == [second.id])
        ends = [status.expected_end, status.together[0].expected_end]
        self.assertTrue(rospy.Time() < ends[0] < ends[1] < status.together[0].deadline, status)
        self.held.end()
        for request in (first, second):
            self.assertOutcome(request, "SUCCEEDED")
        self.assertDriven(2)

    def test_one_that_would_be_late_waits_and_says_why(self):
        first = self.driving_for_one()
        second = self.clients[1].send(GOALS[1], deadline=45.0)  # s; both drives take 56
        why = "does not join (checked kitchen): cannot be in time: (checked bathroom) needs"
        self.queue.wait(lambda queue: [each.waits[: len(why)] for each in queue.requests] == [why])
        second.cancel()
        self.assertOutcome(second, "CANCELLED")
        self.held.end()
        self.assertOutcome(first, "SUCCEEDED")
        self.assertDriven(1)

    def test_the_cancel_of_one_keeps_the_drive_of_the_other(self):
        first, second = self.joined()
        second.cancel()
        self.assertOutcome(second, "CANCELLED")
        self.assertNotIn(GOALS[1], self.knowledge.goals())
        self.held.end()
        self.assertOutcome(first, "SUCCEEDED")
        self.assertDriven(1)

    def test_a_plan_that_is_only_shown_costs_one_that_leaves_nothing(self):
        first, second = self.joined()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        begun, scope = Path(folder.name, "begun"), CallScope()
        os.mkfifo(begun)

        def show():
            with scope, contextlib.suppress(ServiceError):
                self.planning.preview(goals=GOALS)

        rospy.set_param(PLANNER, f"sh -c 'echo > {begun}; exec sleep 1000' DOMAIN PROBLEM")
        self.addCleanup(rospy.set_param, PLANNER, "")
        shown = threading.Thread(target=show, daemon=True)
        shown.start()
        self.addCleanup(shown.join, LONG)
        self.addCleanup(scope.end)
        begun.read_text()
        rospy.set_param(PLANNER, "")
        second.cancel()
        self.assertOutcome(second, "CANCELLED")
        self.held.end()
        self.assertOutcome(first, "SUCCEEDED")
        self.assertDriven(1)

    def test_the_cancel_of_the_one_that_is_driven_for_stops_the_drive(self):
        first, second = self.joined()
        first.cancel()
        self.held.wait_stopped()
        self.assertOutcome(first, "CANCELLED")
        self.held.end()
        self.assertOutcome(second, "SUCCEEDED")
        self.assertFalse(self.knowledge.holds(GOALS[0]))

    def test_a_planner_that_is_killed_keeps_nobody(self):
        first = self.driving_for_one()
        rospy.set_param(PLANNER, "sh -c 'kill -9 $$' DOMAIN PROBLEM")
        self.addCleanup(rospy.set_param, PLANNER, "")
        self.planned.messages.clear()
        second = self.clients[1].send(GOALS[1])
        self.planned.wait(lambda status: status.state == PlannerStatus.CRASHED)
        rospy.set_param(PLANNER, "")
        self.held.end()
        self.assertOutcome(first, "SUCCEEDED")
        self.assertOutcome(second, "SUCCEEDED")
        self.assertEqual(self.cancels.messages, [])
