# SPDX-License-Identifier: Apache-2.0
"""The Executor over real nodes: goals in, robot moved, knowledge true, whatever happens in between."""

import contextlib
import itertools
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import unittest
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalStatus
from merlin_msgs.msg import DispatchStatus, ExecuteActionResult, ExecutorStatus, GoalQueue, KnowledgeChanges
from move_base_msgs.msg import MoveBaseActionGoal
from std_srvs.srv import SetBool, Trigger

from merlin_executor.executor_client import DROP, MerlinExecutorClient, outcome_name
from merlin_executor.goal_check import GoalError
from merlin_executor.mission.goal_state import ACHIEVED
from merlin_planning.knowledge_client import KnowledgeError
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.held_drives import HeldDrives
from merlin_test.node_path import node_path
from merlin_test.topic_links import patient_service, wait_for_publishers

DORM_ROOM = "world/points_of_interest/dorm_room"
PLANNER = "rosplan_planner_interface/planner_command"
TWO_PLANS = """
echo asked >> "$0.asked"
case $(wc -l < "$0.asked") in
  1) echo "0.000: (navigate kitchen dorm_room) [28.800]" ;;
  2) echo "0.000: (navigate anywhere dorm_room) [27.000]" ;;
  *) exec sleep 1000 ;;
esac
echo "28.801: (ask dorm_room) [5.000]"
"""


class Watch:
    """Keeps the messages of a topic and waits for one that fits."""

    def __init__(self, topic, message_class):
        self.messages = []
        self._changed = threading.Condition()
        self._subscriber = rospy.Subscriber(topic, message_class, self._receive, tcp_nodelay=True)
        wait_for_publishers(self._subscriber)

    def _receive(self, message):
        with self._changed:
            self.messages.append(message)
            self._changed.notify_all()

    def wait(self, fits, timeout=LONG):
        with self._changed:
            if not self._changed.wait_for(lambda: any(map(fits, self.messages)), timeout):
                raise AssertionError(f"nothing fitting in {self.messages[-20:]}")
            return next(filter(fits, self.messages))

    def wait_last(self, fits, timeout=LONG):
        with self._changed:
            if not self._changed.wait_for(lambda: self.messages and fits(self.messages[-1]), timeout):
                raise AssertionError(f"the last message does not fit: {self.messages[-1:]}")


def checked(items):
    """The points of interest that are checked, of changed facts."""
    return [item.values[0].value for item in items if item.attribute_name == "checked"]


class Executor(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = MerlinExecutorClient()
        cls.knowledge = MerlinROSPlanAssistant()
        cls.status = Watch("merlin/status", ExecutorStatus)
        cls.queue = Watch("merlin/queue", GoalQueue)
        cls.held = HeldDrives()
        cls.results = Watch("merlin/execute/result", ExecuteActionResult)
        cls.changes = Watch("rosplan_knowledge_base/changes", KnowledgeChanges)
        cls.dispatches = Watch("rosplan_plan_dispatcher/dispatch_status", DispatchStatus)
        cls.drives = Watch("move_base/goal", MoveBaseActionGoal)
        assert cls.client.wait_for_executor(LONG)
        cls.given = cls.knowledge.goals()

    def setUp(self):
        for poi in ("kitchen", "bathroom", "dorm_room", "main_door"):
            self.knowledge.remove_facts(f"(checked {poi})")
        self.begun = rospy.Time.now()  # a message of an earlier test may still come

    def tearDown(self):
        self.held.end()
        # The result and the status come over two connections; either may be first.
        self.status.wait_last(lambda status: status.state == ExecutorStatus.IDLE)
        self.assertEqual(self.knowledge.goals(), self.given)  # those of the problem, and no more
        self.assertEqual(len(self.knowledge.facts("robot_at")), 1)

    def assertOutcome(self, result, name):
        self.assertEqual(outcome_name(result.outcome), name, result.reason)

    def execute_at(self, poi):
        """The robot goes there first."""
        self.assertIn(self.client.execute(f"(robot_at {poi})", LONG).outcome, ACHIEVED)

    def driving(self, goal, **options):
        """Sends a goal; returns its request when the robot drives, which it does until it is cancelled."""
        self.held.hold()
        request = self.client.send(goal, **options)
        self.held.wait_driving()
        return request

    def driven(self, since):
        """How often the robot was sent somewhere."""
        return len([goal for goal in self.drives.messages if goal.goal_id.stamp >= since])

    def ended(self, request):
        """Where the result of a request is among all results."""
        results = self.results.messages
        self.results.wait(lambda result: result.status.goal_id.id == request.id)
        return [result.status.goal_id.id for result in results].index(request.id)

    def test_a_goal_is_planned_and_carried_out(self):
        result = self.client.execute("(checked kitchen)", LONG)
        self.assertOutcome(result, "SUCCEEDED")
        self.assertEqual([action.name for action in result.plan][-1], "ask")
        self.assertEqual(self.knowledge.facts("robot_at"), ["(robot_at kitchen)"])
        self.assertTrue(self.knowledge.holds("(checked kitchen)"))
        self.assertIn("PLAN", [time.stage for time in result.stage_times])

    def test_what_the_knowledge_base_refuses_says_why(self):
        with self.assertRaisesRegex(KnowledgeError, "chekced"):
            self.knowledge.add_facts("(chekced kitchen)")
        with self.assertRaisesRegex(KnowledgeError, "attic"):
            self.knowledge.add_facts("(checked attic)")
        with self.assertRaisesRegex(KnowledgeError, "no function 'batery'"):
            self.knowledge.value("(batery)")

    def test_a_goal_that_holds_ends_at_once(self):
        self.knowledge.add_facts("(checked kitchen)")
        result = self.client.execute("(checked kitchen)", LONG)
        self.assertOutcome(result, "ALREADY_TRUE")
        self.assertEqual(self.driven(self.begun), 0)

    def test_several_goals_are_one_plan(self):
        result = self.client.execute(["(checked kitchen)", "(checked bathroom)"], LONG)
        self.assertOutcome(result, "SUCCEEDED")
        self.assertTrue(self.knowledge.holds("(and (checked kitchen) (checked bathroom))"))

    def test_a_cancel_in_mid_navigation_stops_the_robot(self):
        self.client.execute("(checked kitchen)", LONG)
        request = self.driving("(checked bathroom)")
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "CANCELLED")
        self.assertEqual(request.state, GoalStatus.PREEMPTED)
        self.held.wait_stopped()
        self.assertEqual(self.knowledge.facts("robot_at"), ["(robot_at anywhere)"])
        self.assertFalse(self.knowledge.holds("(checked bathroom)"))
        self.assertOutcome(self.client.execute("(checked bathroom)", LONG), "SUCCEEDED")

    def test_ctrl_c_of_send_cancels_its_goal(self):
        self.held.hold()
        send = subprocess.Popen(
            [node_path("merlin", "send"), "(checked kitchen)"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            said = ""
            while "(navigate" not in said:
                line = send.stdout.readline()
                self.assertTrue(line, said)
                said += line
            self.held.wait_driving()
            os.killpg(send.pid, signal.SIGINT)  # as a terminal does
            _, errors = send.communicate(timeout=LONG)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(send.pid, signal.SIGKILL)
        self.assertEqual(send.returncode, 130, errors)
        self.assertNotIn("Traceback", errors)
        result = self.results.wait(lambda message: message.status.goal_id.stamp >= self.begun).result
        self.assertOutcome(result, "CANCELLED")
        self.assertFalse(self.knowledge.holds("(checked kitchen)"))
        end = time.monotonic() + LONG
        with contextlib.suppress(ProcessLookupError):
            while True:
                os.killpg(send.pid, 0)
                self.assertLess(time.monotonic(), end, "a process of send is left")
                time.sleep(0.05)

    def test_a_cancel_in_the_same_instant_is_not_lost(self):
        for _ in range(10):
            begun = rospy.Time.now()
            request = self.client.send("(checked main_door)")
            request.cancel()
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, "CANCELLED")
            self.assertFalse(self.knowledge.holds("(checked main_door)"))
            self.assertLessEqual(self.driven(begun), 1)

    def test_a_more_urgent_request_interrupts_and_the_first_resumes(self):
        self.client.execute("(checked kitchen)", LONG)
        first = self.driving("(checked bathroom)")
        urgent = self.client.send("(checked main_door)", priority=5)
        for request in (urgent, first):
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, "SUCCEEDED")
        self.assertLess(self.ended(urgent), self.ended(first))

    def test_a_more_urgent_request_waits_for_an_action_that_may_not_be_interrupted(self):
        self.execute_at("kitchen")
        hold = patient_service("speech/hold", SetBool)
        hold(True)
        self.addCleanup(hold, False)
        first = self.client.send(["(checked kitchen)", "(checked bathroom)"])
        asks = self.status.wait(
            lambda each: each.request == first.id and any(action.uninterruptible for action in each.running)
        )
        (ask,) = asks.running
        urgent = self.client.send("(checked main_door)", priority=5)
        waits = f"waits until (ask {ask.parameters[0].value}) can be interrupted"
        self.queue.wait(lambda each: [(e.request, e.waits) for e in each.requests] == [(urgent.id, waits)])
        self.status.wait_last(lambda status: status.urgent_waits == waits)
        self.assertEqual((first.state, urgent.state), (GoalStatus.ACTIVE, GoalStatus.PENDING))
        hold(False)
        for request in (urgent, first):
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, "SUCCEEDED")
        self.assertLess(self.ended(urgent), self.ended(first))
        self.changes.wait(lambda each: each.header.stamp >= self.begun and "bathroom" in checked(each.added))
        fresh = [each for each in self.changes.messages if each.header.stamp >= self.begun]
        self.assertEqual([poi for each in fresh for poi in checked(each.added)][:2][-1], "main_door")

    def test_an_interrupted_request_may_be_dropped(self):
        self.client.execute("(checked kitchen)", LONG)
        first = self.driving("(checked bathroom)", on_interrupt=DROP)
        self.assertOutcome(self.client.execute("(checked main_door)", LONG, priority=1), "SUCCEEDED")
        self.assertTrue(first.wait(LONG))
        self.assertOutcome(first.result, "DROPPED")

    def test_a_waiting_request_is_taken_back(self):
        self.client.execute("(checked kitchen)", LONG)
        first = self.driving("(checked bathroom)")
        waiting = self.client.send("(checked main_door)")
        waiting.cancel()
        self.assertTrue(waiting.wait(LONG))
        self.assertOutcome(waiting.result, "CANCELLED")
        self.held.end()
        self.assertTrue(first.wait(LONG))
        self.assertOutcome(first.result, "SUCCEEDED")

    def together(self, *goals):
        """Sends goals as two clients in turn, which begin in the same moment."""
        other = MerlinExecutorClient()
        self.assertTrue(other.wait_for_executor(LONG))
        pause, resume = (rospy.ServiceProxy(f"merlin/{name}", Trigger) for name in ("pause", "resume"))
        pause()
        self.addCleanup(resume)
        requests = [client.send(goal) for client, goal in zip(itertools.cycle([self.client, other]), goals)]
        self.queue.wait_last(lambda queue: len(queue.requests) == len(goals))
        resume()
        return requests

    def test_errands_are_done_by_one_plan_and_each_ends_when_its_own_goal_holds(self):
        self.assertIn(self.client.execute("(robot_at kitchen)", LONG).outcome, ACHIEVED)
        self.held.hold()
        goals = ("(checked bathroom)", "(checked main_door)", "(checked dorm_room)")
        requests = self.together(*goals)
        self.held.wait_driving()
        status = self.status.wait(lambda status: status.header.stamp >= self.begun and status.together)
        found = [status.request, *(other.request for other in status.together)]
        self.assertEqual(found, [request.id for request in requests])
        self.held.hold()  # the first drive ends, and the second one lasts
        first = self.results.wait(lambda message: message.status.goal_id.id in found)
        self.assertOutcome(first.result, "SUCCEEDED")
        steps = [action.name for action in first.result.plan]
        self.assertEqual((steps.count("ask"), steps.count("navigate")), (3, 3))
        ended = goals[found.index(first.status.goal_id.id)]
        self.assertTrue(self.knowledge.holds(ended))
        self.assertNotIn(ended, self.knowledge.goals())
        left = [request for request in requests if request.id != first.status.goal_id.id]
        self.assertFalse(any(request.done for request in left))
        left[0].cancel()
        self.assertTrue(left[0].wait(LONG))
        self.assertOutcome(left[0].result, "CANCELLED")
        self.held.end()
        self.assertTrue(left[1].wait(LONG))
        self.assertOutcome(left[1].result, "SUCCEEDED")

    def test_an_impossible_errand_does_not_keep_the_others(self):
        self.assertIn(self.client.execute("(robot_at kitchen)", LONG).outcome, ACHIEVED)
        requests = self.together("(checked bathroom)", "(robot_at anywhere)", "(checked main_door)")
        for request, outcome in zip(requests, ("SUCCEEDED", "UNSOLVABLE", "SUCCEEDED")):
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, outcome)

    def unreachable_dorm_room(self):
        """Planning does not know that the point of interest has no place to drive to.

        The first plan begins in the kitchen, further ones anywhere: two failures that differ, then the same.
        """
        self.assertIn(self.client.execute("(robot_at kitchen)", LONG).outcome, ACHIEVED)
        place = rospy.get_param(DORM_ROOM)
        rospy.set_param(DORM_ROOM, {"x": "nowhere"})
        self.addCleanup(rospy.set_param, DORM_ROOM, place)

    def test_a_plan_that_fails_is_replaced_a_few_times(self):
        self.unreachable_dorm_room()
        result = self.client.execute("(checked dorm_room)", LONG)
        self.assertOutcome(result, "ACTION_FAILED")
        self.assertIn("navigate", result.action)
        self.assertIn("2 times for the same reason", result.reason)
        self.assertGreater(result.replans, 0)

    def test_a_point_that_does_not_exist_is_not_tried_again_and_moves_nothing(self):
        self.assertIn(self.client.execute("(robot_at kitchen)", LONG).outcome, ACHIEVED)
        place = rospy.get_param(DORM_ROOM)
        rospy.delete_param(DORM_ROOM)
        self.addCleanup(rospy.set_param, DORM_ROOM, place)
        result = self.client.execute("(checked dorm_room)", LONG)
        self.assertOutcome(result, "ACTION_FAILED")
        self.assertIn("unknown point of interest 'dorm_room'", result.reason)
        self.assertIn("no plan without it", result.reason)
        self.assertEqual(self.knowledge.facts("robot_at"), ["(robot_at kitchen)"])
        rospy.set_param(DORM_ROOM, place)  # and nothing of that is left for the next request
        self.assertOutcome(self.client.execute("(checked dorm_room)", LONG), "SUCCEEDED")

    def test_a_goal_that_was_undone_meanwhile_is_planned_again(self):
        # From there it drives to each of the two, and does not come to the second before one is undone.
        self.assertIn(self.client.execute("(robot_at bathroom)", LONG).outcome, ACHIEVED)
        begun = rospy.Time.now()
        request = self.driving(["(checked kitchen)", "(checked main_door)"])
        self.held.hold()
        change = self.changes.wait(lambda change: change.header.stamp >= begun and checked(change.added))
        undone = f"(checked {checked(change.added)[0]})"
        self.knowledge.remove_facts(undone)
        # At once: the drive to the second would never end.
        told = self.dispatches.wait(
            lambda status: status.header.stamp >= begun and status.state == DispatchStatus.IDLE
        )
        self.held.end()
        self.assertEqual(
            told.reason, f"the plan no longer fits: its goal is not reached: {undone} does not hold"
        )
        self.assertIn(undone, told.unmet_goals)
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")
        self.assertEqual(request.result.replans, 1)
        self.assertTrue(self.knowledge.holds(undone))

    def test_a_goal_that_comes_true_by_itself_ends_its_request(self):
        self.assertIn(self.client.execute("(robot_at kitchen)", LONG).outcome, ACHIEVED)
        request = self.driving("(checked bathroom)")
        self.knowledge.add_facts("(checked bathroom)")
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")
        self.assertEqual(request.result.replans, 0)
        self.held.wait_stopped()
        self.assertEqual(self.knowledge.facts("robot_at"), ["(robot_at anywhere)"])

    def test_a_cancel_reaches_a_request_that_waits_before_it_is_planned_again(self):
        self.unreachable_dorm_room()
        # It waits for a second. A cancel that is late comes while a third plan is made, for ever.
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        planner = Path(folder) / "planner.sh"
        planner.write_text(TWO_PLANS)
        self.addCleanup(rospy.set_param, PLANNER, "")
        rospy.set_param(PLANNER, f"sh {planner} DOMAIN PROBLEM")
        request = self.client.send("(checked dorm_room)")

        def waits(status):
            return status.header.stamp >= self.begun and (status.stage, status.replans) == ("REPLAN", 1)

        self.status.wait(waits)
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "CANCELLED")

    def test_a_deadline_stops_the_robot_and_the_next_request_begins_at_its_time(self):
        """One waits for its time, the other runs until its deadline: ROS time, and no further event."""
        self.execute_at("kitchen")
        way = "travel_time", "kitchen", "bathroom"
        self.addCleanup(self.knowledge.set_value, *way, value=self.knowledge.value(*way))
        self.knowledge.set_value(*way, value=0.5)  # as planned it is in time
        begin = rospy.Time.now() + rospy.Duration(15.0)
        waiting = self.client.send("(checked kitchen)", not_before=begin)
        late = self.driving("(robot_at bathroom)", deadline=12.0)  # the other one does not keep it waiting
        known = self.status.wait(lambda status: status.request == late.id and status.expected_end.to_sec())
        self.assertEqual(known.late, "")
        self.assertTrue(late.wait(LONG))
        self.assertOutcome(late.result, "LATE")
        self.assertEqual(late.state, GoalStatus.ABORTED)
        self.held.end()
        self.assertTrue(waiting.wait(LONG))
        self.assertOutcome(waiting.result, "SUCCEEDED")
        began = self.status.wait(lambda status: status.request == waiting.id)
        self.assertGreaterEqual(began.header.stamp, begin)

    def test_a_request_that_cannot_be_in_time_ends_before_the_robot_moves(self):
        self.execute_at("kitchen")
        begun = rospy.Time.now()
        result = self.client.execute("(checked bathroom)", LONG, deadline=20.0)  # of the 32 s that it takes
        self.assertOutcome(result, "LATE")
        self.assertRegex(
            result.reason,
            r"cannot be in time: \(checked bathroom\) needs [\d.]+ s, its deadline is in (1?\d\.\d|20\.0) s$",
        )
        self.assertEqual(self.driven(begun), 0)

    def test_when_a_request_that_waits_will_be_done_is_known_before_it_begins(self):
        self.execute_at("kitchen")
        way = "travel_time", "kitchen", "bathroom"
        running = self.driving("(checked bathroom)")
        end = rospy.Duration(self.knowledge.value(*way) + 5.0)
        self.addCleanup(running.cancel)
        begun = rospy.Time.now()
        hopeless = self.client.send("(checked dorm_room)", deadline=end.to_sec() + 4.0, alone=True)
        possible = self.client.send("(checked main_door)", deadline=900.0, alone=True)

        def known(queue):
            found = {queued.request: queued for queued in queue.requests}
            return {hopeless.id, possible.id} <= set(found) and all(
                found[request.id].expected_end.to_sec() for request in (hopeless, possible)
            )

        found = {queued.request: queued for queued in self.queue.wait(known).requests}
        self.assertIn("cannot be done before its deadline", found[hopeless.id].late)
        self.assertEqual(found[possible.id].late, "")
        self.assertGreater(found[possible.id].expected_end - begun, end)  # behind what runs
        for request in (hopeless, possible, running):
            request.cancel()
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, "CANCELLED")

    def test_what_makes_no_sense_is_refused_before_it_is_sent(self):
        for goal in (
            "(checked moon)",
            "(clean kitchen)",
            "(checked kitchen bathroom)",
            "checked",
            "(checked",
        ):
            with self.assertRaises(ValueError):
                self.client.send(goal)
        with self.assertRaises(GoalError):
            self.client.send([])

    def test_the_executor_refuses_too(self):
        unchecked = MerlinExecutorClient(knowledge_base=None)
        self.assertTrue(unchecked.wait_for_executor(LONG))
        request = unchecked.send("(checked moon)")
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "REFUSED")
        self.assertEqual(request.state, GoalStatus.REJECTED)
        self.assertIn("moon", request.result.reason)

    def test_a_planner_that_gives_up_has_not_proved_anything(self):
        rospy.set_param(PLANNER, "echo No plan found in 8 happenings: DOMAIN PROBLEM")
        try:
            result = self.client.execute("(checked bathroom)", LONG)
        finally:
            rospy.set_param(PLANNER, "")
        self.assertOutcome(result, "NO_PLAN")
        self.assertIn("8 happenings", result.reason)

    def test_what_cannot_be_reached_says_why(self):
        self.assertIn(self.client.execute("(robot_at kitchen)", LONG).outcome, ACHIEVED)
        result = self.client.execute("(robot_at anywhere)", LONG)
        self.assertOutcome(result, "UNSOLVABLE")
        self.assertIn("(robot_at anywhere); no action can make it true", result.reason)

    def test_what_is_too_large_is_refused_and_the_executor_goes_on(self):
        unchecked = MerlinExecutorClient(knowledge_base=None)
        self.assertTrue(unchecked.wait_for_executor(LONG))
        nested = "(and " * 1000 + "(checked kitchen)" + ")" * 1000
        for goal, why in ((nested, "nested deeper"), ("(checked moon)" + " " * 60000, "no object")):
            request = unchecked.send(goal)
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, "REFUSED")
            self.assertIn(why, request.result.reason)
        self.assertOutcome(self.client.execute("(checked kitchen)", LONG), "SUCCEEDED")
