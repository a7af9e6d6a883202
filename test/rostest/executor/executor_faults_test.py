# SPDX-License-Identifier: Apache-2.0
"""Processes around the Executor die, hang, or do not obey (docs/reliability.md).

The robot stops, the answer is true, and the next goal works without help.
"""

import os
import signal
import subprocess
import threading
from contextlib import contextmanager
from pathlib import Path

import rospy
from actionlib_msgs.msg import GoalStatusArray
from executor_faults_case import CHECKED, FaultsCase
from executor_faults_fixture import Changes, Watch, client_process, kill, start
from merlin_msgs.msg import ExecuteActionGoal, GoalQueue, Lease, MissionStatus, PlannerStatus
from rosplan_dispatch_msgs.srv import DispatchService
from std_srvs.srv import Empty

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.resending import RESEND
from merlin_planning.knowledge_client import ADD_GOAL, REMOVE_GOAL, Update, fact
from merlin_ros.actions.lease import LOSE_AFTER, LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_test import LONG
from merlin_test.knowledge_fixture import Received
from merlin_test.process_signals import hang
from merlin_test.topic_links import pid_of

PLANNER = "rosplan_planner_interface/planner_command"


class Faults(FaultsCase):
    @contextmanager
    def client_driving(self, *arguments):
        """A client of its own that wants the kitchen checked, and has the robot drive likewise."""
        self.drives.hold()
        with client_process(*arguments) as client:
            self.drives.wait_driving()
            yield client

    def assertNextGoalWorks(self, goal="(checked main_door)"):
        self.knowledge.remove_facts(goal)
        self.assertOutcome(self.client.execute(goal, LONG), "SUCCEEDED")
        self.assertEqual(len(self.knowledge.facts("robot_at")), 1)
        self.assertNotIn(goal, self.knowledge.goals())
        self.assertNotIn("(checked kitchen)", self.knowledge.goals())

    # --- the Executor -----------------------------------------------------------------------------------

    def test_an_executor_that_is_killed_leaves_nothing_that_moves(self):
        request = self.driving()
        killed = rospy.Time.now()
        kill(self.executor)
        self.drives.wait_stopped()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "INTERNAL")
        self.system.wait_executor_gone()
        self.start_executor()
        self.dispatch.wait_idle(killed)
        self.assertEqual(len(self.knowledge.facts("robot_at")), 1)
        self.assertNextGoalWorks()

    def test_what_survives_goes_on_after_a_power_cut_and_its_client_finds_it(self):
        request = self.driving(survives=True)
        orphan = self.client.send("(checked main_door)", survives=True)
        queue = Watch("merlin/queue", GoalQueue)
        queue.wait(lambda queue: orphan.id in [waiting.request for waiting in queue.requests])
        orphan.leave()  # as if its client were gone
        for process in (self.executor, self.planning):
            kill(process)
        self.drives.wait_stopped()
        self.system.wait_executor_gone()
        self.system.start_planning()
        self.knowledge.remove_facts(CHECKED)
        before = request.id
        self.start_executor()
        self.drives.wait_driving()
        self.drives.end()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")
        self.assertEqual(request.id, before)
        follower = MerlinExecutorClient().follow(orphan.id)
        self.assertTrue(follower.wait(LONG))
        self.assertTrue(self.knowledge.holds("(checked main_door)"), follower.result)
        self.assertNextGoalWorks()

    def test_an_errand_of_a_day_survives_its_mission_and_the_executor(self):
        day = Path(self.system.folder, "day.yaml")
        day.write_text("- every: 1s\n  goals: (checked kitchen)\n  survives: true\n")
        self.addCleanup(self.forget)  # the errand would go on
        goals = Watch("merlin/execute/goal", ExecuteActionGoal)
        mission = Watch("merlin/mission", MissionStatus)
        self.drives.hold()
        with self.day(day):
            self.drives.wait_driving()
            errand = self.status.wait(lambda status: status.running).request
        kill(self.executor)
        self.drives.wait_stopped()
        self.system.wait_executor_gone()
        self.drives.hold()
        self.start_executor()
        self.drives.wait_driving()
        begun = rospy.Time.now()
        with self.day(day):
            mission.wait(lambda status: status.state == MissionStatus.RUNNING, begun)
            goals.wait(lambda sent: sent.goal_id.id == errand, begun)  # sent once more, which finds it
            status = self.status.wait(lambda status: status.running)
            self.assertEqual((status.request, status.together), (errand, []))
            ended = rospy.Time.now()
            self.drives.end()
            # Its next time: the mission knows that the one that it has found has ended.
            goals.wait(lambda sent: sent.goal_id.id == errand, ended)
            self.assertTrue(self.knowledge.holds("(checked kitchen)"))

    @staticmethod
    @contextmanager
    def day(file):
        """A mission that sends the errands of a file."""
        kind = "mission:=merlin_executor.mission:Day"
        mission = start("merlin_executor", "mission", "__name:=day", kind, f"_file:={file}")
        try:
            yield
        finally:
            kill(mission)

    def test_the_goals_of_a_hung_executor_are_removed_before_it_goes_on(self):
        changes = Changes("(checked kitchen)")
        request = self.driving()
        node = pid_of("/merlin_executor")
        hang(node)
        try:
            self.drives.wait_stopped()
            changes.wait_removed()
            self.assertTrue(request.wait(LONG))
            self.assertOutcome(request.result, "INTERNAL")
        finally:
            resumed = rospy.Time.now()
            os.kill(node, signal.SIGCONT)
        status = self.status.wait_idle(resumed)
        self.assertIn("cancelled", status.reason)
        self.assertFalse(self.knowledge.holds("(checked kitchen)"))
        self.assertNextGoalWorks()

    def test_an_executor_that_hung_carries_on_what_its_client_still_wants(self):
        changes = Changes("(checked kitchen)")
        with self.client_driving("--go-on") as client:
            kill(client)  # so that nothing but the Executor itself decides about the request
            node = pid_of("/merlin_executor")
            stopped = rospy.Time.now()
            hang(node)
            try:
                changes.wait_removed()
                self.dispatch.wait_idle(stopped)
            finally:
                resumed = rospy.Time.now()
                os.kill(node, signal.SIGCONT)
            status = self.status.wait_idle(resumed)
        self.assertTrue(self.knowledge.holds("(checked kitchen)"), status.reason)
        self.assertNextGoalWorks()

    def test_a_mission_survives_its_executor(self):
        request = self.driving(on_lost=RESEND)
        kill(self.executor)
        self.drives.wait_stopped()
        self.system.wait_executor_gone()
        self.start_executor()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")
        self.assertTrue(self.knowledge.holds("(checked kitchen)"))
        self.assertNextGoalWorks()

    def test_a_request_that_met_a_dying_executor_is_carried_out_by_the_next(self):
        hang(pid_of("/merlin_executor"))
        request = self.client.send("(robot_at kitchen)")
        kill(self.executor)
        self.start_executor()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")

    def test_the_command_send_says_that_it_waits_for_an_executor_that_hangs(self):
        node = pid_of("/merlin_executor")
        hang(node)
        try:
            send = start("merlin", "send", "(robot_at kitchen)", output=subprocess.PIPE)
            self.addCleanup(kill, send)
            self.assertIn("waiting for the Executor", send.stdout.readline())
        finally:
            os.kill(node, signal.SIGCONT)
        output, _ = send.communicate(timeout=LONG)
        self.assertEqual(send.returncode, 0, output)

    def test_a_second_executor_names_the_first_and_does_not_serve(self):
        second = start("merlin_executor", "executor", "__name:=another", output=subprocess.PIPE)
        output, _ = second.communicate(timeout=LONG)
        self.assertNotEqual(second.returncode, 0)
        self.assertIn("/merlin_executor is an executor of the same planning system already", output)
        self.assertNextGoalWorks()

    # --- its client -------------------------------------------------------------------------------------

    def test_a_client_that_dies_takes_its_request_along(self):
        with self.client_driving() as client:
            killed = rospy.Time.now()
            kill(client)
            self.drives.wait_stopped()
        status = self.status.wait_idle(killed)
        self.assertIn("its client /executor_victim", status.reason)
        self.assertNextGoalWorks()

    def test_a_request_may_go_on_without_its_client(self):
        with self.client_driving("--go-on") as client:
            killed = rospy.Time.now()
            kill(client)
            self.drives.end()
            status = self.status.wait_idle(killed)
        self.assertTrue(self.knowledge.holds("(checked kitchen)"), status.reason)

    def test_a_client_may_hang_for_as_long_as_the_executor_allows(self):
        long_silent = threading.Event()
        watch = LeaseWatch(
            "merlin/execute/lease",
            lambda change: change.state is LeaseState.LOST and long_silent.set(),
            lose_after=2 * LOSE_AFTER,
        )
        self.addCleanup(watch.shutdown)
        leases = Received("merlin/execute/lease", Lease)  # behind the watch, which hears them first
        self.addCleanup(leases.close)
        with self.client_driving() as client:
            leases.wait(lambda lease: lease.owner == "/executor_victim" and lease.held)
            hang(client.pid)
            self.assertTrue(long_silent.wait(LONG))
            resumed = rospy.Time.now()
            os.kill(client.pid, signal.SIGCONT)
            self.drives.end()
            status = self.status.wait_idle(resumed)
        self.assertTrue(self.knowledge.holds("(checked kitchen)"), status.reason)

    # --- the planning system ----------------------------------------------------------------------------

    def test_a_planning_system_that_returns_is_used_again(self):
        request = self.driving()
        kill(self.planning)
        self.drives.wait_stopped()
        self.system.start_planning()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "SUCCEEDED")
        self.assertGreater(request.result.replans, 0)
        self.assertNextGoalWorks()

    def test_a_hung_planning_system_is_told_within_ten_seconds_of_the_cancel(self):
        request = self.driving()  # the planning system may take its time: until then it waits for the cancel
        hang(self.planning.pid)
        try:
            self.drives.wait_stopped()  # nothing owns the drive any more
            request.cancel()
            self.assertTrue(request.wait(LONG))
        finally:
            os.kill(self.planning.pid, signal.SIGCONT)
        self.assertOutcome(request.result, "CANCEL_TIMEOUT")
        self.assertIn("the planning system's plan dispatcher", request.result.reason)
        self.assertIn("the guard has halted the base", request.result.reason)
        self.assertNextGoalWorks()

    def test_a_cancel_does_not_wait_for_a_knowledge_base_that_hangs(self):
        client = MerlinExecutorClient(knowledge_base=None)
        self.assertTrue(client.wait_for_executor(LONG))
        statuses = Watch("merlin/execute/status", GoalStatusArray)
        hang(self.planning.pid)
        try:
            request = client.send("(checked kitchen)")
            statuses.wait(lambda status: request.id in [goal.goal_id.id for goal in status.status_list])
            request.cancel()
            self.assertTrue(request.wait(LONG))
        finally:
            os.kill(self.planning.pid, signal.SIGCONT)
        self.assertOutcome(request.result, "CANCELLED")
        self.assertIn("the planning system's knowledge base: service", request.result.reason)
        self.assertNextGoalWorks()

    def test_a_planning_system_that_hangs_while_a_newcomer_is_planned(self):
        planned = Watch("rosplan_planner_interface/planner_status", PlannerStatus)
        request = self.driving()
        self.addCleanup(rospy.set_param, PLANNER, "")
        rospy.set_param(PLANNER, "sh -c 'exec sleep 1000' DOMAIN PROBLEM")
        begun = rospy.Time.now()
        newcomer = MerlinExecutorClient().send("(checked main_door)")
        planned.wait(lambda status: status.state == PlannerStatus.RUNNING, begun)
        hang(self.planning.pid)
        try:
            newcomer.cancel()
            self.assertTrue(newcomer.wait(LONG))
            request.cancel()
            self.assertTrue(request.wait(LONG))
        finally:
            os.kill(self.planning.pid, signal.SIGCONT)
        self.assertOutcome(newcomer.result, "CANCELLED")
        self.assertOutcome(request.result, "CANCEL_TIMEOUT")
        rospy.set_param(PLANNER, "")
        self.assertNextGoalWorks()
        self.assertNotIn("(checked main_door)", self.knowledge.goals())

    def test_a_plan_without_an_owner_gives_way(self):
        self.knowledge.knowledge.update([Update(ADD_GOAL, fact("checked", "kitchen"))])
        for service in (
            "rosplan_problem_interface/problem_generation_server",
            "rosplan_planner_interface/planning_server",
            "rosplan_parsing_interface/parse_plan",
        ):
            rospy.ServiceProxy(service, Empty)()
        dispatch = rospy.ServiceProxy("rosplan_plan_dispatcher/dispatch_plan", DispatchService)
        by_hand = threading.Thread(target=dispatch, name="dispatch by hand", daemon=True)
        self.drives.hold()
        by_hand.start()
        self.drives.wait_driving()
        self.knowledge.knowledge.update([Update(REMOVE_GOAL, fact("checked", "kitchen"))])
        self.assertNextGoalWorks()
        by_hand.join(LONG)
        self.assertFalse(self.knowledge.holds("(checked kitchen)"))

    # --- what does not stop -----------------------------------------------------------------------------

    def test_what_does_not_stop_is_named_and_the_base_halted(self):
        request = self.driving()
        self.guard.wait_heard()
        self.assertFalse(self.guard.braked.is_set())
        host = pid_of("/merlin_fsm_host")
        hang(host)
        try:
            request.cancel()
            # At once, though what has to end the drive hangs.
            self.assertTrue(self.guard.braked.wait(LONG))
            self.assertFalse(request.done)
            self.assertTrue(request.wait(LONG))
        finally:
            os.kill(host, signal.SIGCONT)
        self.assertOutcome(request.result, "CANCEL_TIMEOUT")
        words = r"^\(navigate .*\) did not stop: .*/actions/navigate .*; the guard has halted the base$"
        self.assertRegex(request.result.reason, words)
        self.assertTrue(self.guard.halted.is_set())
        self.drives.wait_stopped()
        self.assertNextGoalWorks()

    def test_a_cancel_is_not_complete_while_the_base_moves(self):
        request = self.driving()
        self.guard.wait_heard()
        self.guard.says(moving=True)
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "CANCEL_TIMEOUT")
        self.assertIn("the base still moves", request.result.reason)
        self.assertTrue(self.guard.halted.is_set())


class OtherLimits(FaultsCase):
    """An Executor that does not wait for a planning system, but for a base that comes to rest."""

    def usual(self):
        return {"planning_system_return": 1.0, "stand_wait": LONG}

    def test_a_planning_system_that_stays_away_is_named(self):
        request = self.driving()
        kill(self.planning)
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "INTERNAL")
        self.assertIn("the planning system's plan dispatcher", request.result.reason)
        self.assertIn("did not return within 1 s", request.result.reason)
        self.assertNotIn("Errno", request.result.reason)
        self.drives.wait_stopped()

    def test_a_base_that_comes_to_rest_a_moment_later_is_a_complete_cancel(self):
        self.guard.wait_heard()
        request = self.driving()
        self.guard.says(moving=True)
        request.cancel()
        self.drives.wait_stopped()
        self.guard.says(moving=False)
        self.assertTrue(request.wait(LONG))
        self.assertOutcome(request.result, "CANCELLED")
        self.assertFalse(self.guard.halted.is_set())
