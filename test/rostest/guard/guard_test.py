# SPDX-License-Identifier: Apache-2.0
"""The guard's node: what reaches the base while goals, their owners and the guard itself come and go."""

import os
import signal
import subprocess
import threading

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import PoseStamped, Twist
from guard_case import HOLDING, IDLE, LIVE, PASSING, STOPPED, GuardCase
from guard_fixture import Witness, refused_guard
from merlin_msgs.msg import SimStatus
from move_base_msgs.msg import MoveBaseActionGoal
from sensor_msgs.msg import Joy
from std_msgs.msg import Empty
from std_srvs.srv import Empty as EmptyService

from merlin_sm import guard_watch
from merlin_sm.states.merlin_state import ABORTED
from merlin_sm.states.navigation import NavigationState
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.process_signals import hang
from merlin_test.topic_links import pid_of


class Guard(GuardCase):
    def test_a_motion_ends_with_its_goal(self):
        self.drive()
        self.witness.wait(lambda: self.witness.status.moving)
        rospy.ServiceProxy("move_base/end", EmptyService)()
        self.witness.state(IDLE)
        self.witness.wait(lambda: not self.witness.velocities[-1] and not self.witness.status.moving)

    def test_a_command_without_a_goal_does_not_pass(self):
        forward = Twist()
        forward.angular.z = 1.0
        self.witness.forget()
        for number in range(1, 6):
            self.commands.publish(forward)
            self.witness.wait(lambda: len(self.witness.velocities) >= number)  # noqa: B023
        self.assertNotIn(True, self.witness.velocities)

    def test_a_velocity_that_is_not_finite_does_not_pass(self):
        self.drive()
        wrong = Twist()
        wrong.linear.x = float("nan")
        with self.witness.changed:
            self.witness.velocities.clear()
        self.commands.publish(wrong)
        self.witness.wait(lambda: False in self.witness.velocities)

    def test_an_owner_that_is_killed_stops_the_base_and_its_goal(self):
        client = self.start_client()
        goal = self.drive(client)
        client.process.kill()
        self.witness.has_said(HOLDING, "victim")
        self.ended(goal)
        self.witness.state(IDLE)
        self.zero()
        self.drive(self.start_client())

    def test_an_owner_that_hangs_stops_the_base_until_it_goes_on(self):
        client = self.start_client()
        goal = self.drive(client)
        hang(client.process.pid)
        self.witness.has_said(HOLDING, "silent")
        self.zero()
        client.process.send_signal(signal.SIGCONT)
        self.witness.state(PASSING)
        self.witness.wait(lambda: self.witness.velocities[-1])
        self.assertEqual(self.witness.goals[goal], GoalStatus.ACTIVE)

    def test_an_owner_that_hangs_for_long_loses_its_goal(self):
        client = self.start_client()
        goal = self.drive(client)
        hang(client.process.pid)
        self.ended(goal)
        self.zero()

    def test_a_suspended_goal_stands_until_it_is_resumed(self):
        self.drive()
        self.client.ask("suspend")
        self.witness.state(HOLDING, "its own owner is silent")
        self.stands()
        self.client.ask("resume")
        self.witness.state(PASSING)
        self.witness.wait(lambda: self.witness.velocities[-1])

    def test_a_goal_that_its_owner_lets_go_is_cancelled(self):
        goal = self.drive()
        self.client.ask("release")
        self.ended(goal)

    def test_a_restarted_owner_loses_the_goals_of_its_former_life(self):
        client = self.start_client()
        goal = self.drive(client)
        self.stubborn(True)
        client.process.kill()
        self.drive_of_new_life()
        self.witness.state(HOLDING)
        self.stands()
        self.assertIn(self.witness.goals[goal], LIVE)
        self.stubborn(False)
        rospy.ServiceProxy("move_base/end", EmptyService)()

    def drive_of_new_life(self):
        goal = self.start_client().ask("drive")
        self.witness.wait(lambda: goal in self.witness.status.goals)

    def test_a_cancel_that_is_ignored_stops_the_base_until_the_goal_ends(self):
        goal = self.drive()
        self.stubborn(True)
        self.cancel.publish(GoalID(id=goal))
        self.witness.state(HOLDING, "was cancelled and still runs")
        self.stands()
        rospy.ServiceProxy("move_base/end", EmptyService)()
        self.witness.state(IDLE)
        self.drive()

    def test_a_cancel_that_is_followed_is_not_the_guards_concern(self):
        goal = self.drive()
        self.cancel.publish(GoalID())
        self.ended(goal)
        self.witness.state(IDLE)

    def test_a_stop_lasts_until_its_release(self):
        goal = self.drive()
        self.assertTrue(self.call("merlin/stop").success)
        self.witness.state(STOPPED, "stopped by /guard")
        self.ended(goal)
        second = self.client.ask("drive")
        self.ended(second)
        self.witness.state(STOPPED)
        self.zero()
        self.assertEqual(self.call("merlin/release").message, "released")
        self.drive()

    def test_a_stop_wins_over_a_base_that_goes_on(self):
        self.drive()
        self.stubborn(True)
        self.stop_topic.publish(Empty())
        self.witness.state(STOPPED, "topic merlin/stop")
        self.stands()
        self.call("merlin/release")
        self.witness.state(HOLDING, "topic merlin/stop")
        self.stands()

    def test_a_button_stops(self):
        goal = self.drive()
        self.joy.publish(Joy(buttons=[1, 1, 1, 0, 1]))
        self.joy.publish(Joy(buttons=[0]))
        self.joy.publish(Joy(buttons=[0, 0, 0, 1]))
        self.witness.state(STOPPED, "button 3 of /joy")
        self.ended(goal)

    def test_halt_concerns_the_goals_that_run(self):
        goal = self.drive()
        self.stubborn(True)
        answer = self.call("merlin/halt")
        self.assertIn(goal, answer.message)
        self.witness.state(HOLDING, "halted by /guard")
        self.stands()
        rospy.ServiceProxy("move_base/end", EmptyService)()
        self.drive()

    def test_a_brake_holds_the_base_until_its_goals_have_ended(self):
        self.drive()
        self.brake.publish("/executor cancels\nits action")
        self.witness.state(HOLDING, "/executor cancels its action")
        self.stands()
        rospy.ServiceProxy("move_base/end", EmptyService)()
        self.drive()

    def test_a_guard_that_was_killed_begins_with_zero_and_lets_the_owned_goal_go_on(self):
        self.drive()
        wait_back = self.kill_guard()
        self.witness.wait(lambda: False in self.witness.velocities)
        self.witness.forget()
        self.witness.wait(lambda: any(self.witness.velocities))
        wait_back()

    def test_a_guard_that_was_killed_does_not_adopt_a_goal_without_an_owner(self):
        sender = rospy.Publisher("move_base/goal", MoveBaseActionGoal, queue_size=1)
        self.addCleanup(sender.unregister)
        self.witness.wait(lambda: sender.get_num_connections() == 2)
        sender.publish(MoveBaseActionGoal(goal_id=GoalID(rospy.Time.now(), "rviz")))
        self.witness.wait(lambda: self.witness.velocities and self.witness.velocities[-1])
        wait_back = self.kill_guard()
        self.witness.has_said(HOLDING, "it ran before the guard began, and no lease names it")
        self.zero()
        self.witness.forget()
        self.ended("rviz")
        self.assertNotIn(True, self.witness.velocities)
        wait_back()

    def test_a_motion_server_that_hangs_stops_the_base_though_somebody_says_that_a_simulator_is_paused(self):
        simulator = rospy.Publisher("/merlin_sim/status", SimStatus, latch=True, queue_size=1)
        self.addCleanup(simulator.unregister)
        simulator.publish(SimStatus(paused=True, achieved_factor=1.0))
        self.drive()
        pid = pid_of("/base")
        hang(pid)
        try:
            self.witness.has_said(HOLDING, "status has been silent for 1 s")
            self.zero()
        finally:
            os.kill(pid, signal.SIGCONT)
        self.witness.state(PASSING)
        self.assertEqual(simulator.get_num_connections(), 0, "nobody on a robot listens to it")

    def test_a_guard_that_ends_sends_zero(self):
        side = Witness("/side/cmd_vel")
        self.addCleanup(side.close)
        guard = [node_path("merlin_guard", "guard"), "__ns:=/side", "cmd_vel_in:=/cmd_vel_in"]
        process = subprocess.Popen([*guard, "_motion_servers:=[/move_base]"])
        self.addCleanup(process.kill)
        side.wait(lambda: side.velocities)  # the zero of a new connection
        self.drive()
        side.wait(lambda: side.velocities[-1])
        os.kill(pid_of("/side/merlin_guard"), signal.SIGTERM)
        self.assertEqual(process.wait(LONG), 128 + signal.SIGTERM)
        side.wait(lambda: not side.velocities[-1])

    def test_a_guard_that_was_killed_is_still_stopped(self):
        self.stop_by.publish("Ana\n")
        self.witness.state(STOPPED, "stopped by Ana ")
        with self.witness.changed:
            since = self.witness.status.since
        # A master that is slow keeps it some moments after the guard has said it.
        while "Ana" not in rospy.get_param("/merlin_guard/stopped", ""):
            rospy.rostime.wallsleep(0.05)
        self.kill_guard()()
        with self.witness.changed:
            self.witness.status = None
        self.witness.state(STOPPED, "stopped by Ana ")
        # As far as a parameter keeps it.
        self.assertAlmostEqual(self.witness.status.since.to_sec(), since.to_sec(), places=3)
        goal = self.start_client().ask("drive")
        self.ended(goal)

    def test_nothing_sets_off_while_the_guard_is_stopped_or_silent(self):
        state = NavigationState(target=PoseStamped())
        self.call("merlin/stop")
        watch = guard_watch.shared_guard_watch()
        while "has stopped the base" not in watch.why_not(lambda: True):  # without a wait
            rospy.rostime.wallsleep(0.05)
        self.assertEqual(state.execute(None), ABORTED)
        self.assertEqual(
            state.reason, "the velocity guard has stopped the base: stopped by " + rospy.get_name()
        )
        self.call("merlin/release")
        self.witness.state(IDLE)
        pid = pid_of("/merlin_guard")
        hang(pid)
        try:
            while watch.why_not(lambda: True) != guard_watch.SILENT:  # what it said before counts for a while
                rospy.rostime.wallsleep(0.05)
            self.assertEqual(state.execute(None), ABORTED)
            self.assertEqual(state.reason, guard_watch.SILENT)
        finally:
            os.kill(pid, signal.SIGCONT)
        ended = threading.Event()
        driver = threading.Thread(target=lambda: (state.execute(None), ended.set()), daemon=True)
        driver.start()
        self.witness.state(PASSING)
        state.request_preempt()
        self.assertTrue(ended.wait(LONG))

    def test_a_second_guard_does_not_begin_and_harms_nothing(self):
        goal = self.drive()
        self.assertIn("/merlin_guard guards /cmd_vel already", refused_guard("__name:=second"))
        text = refused_guard("__name:=second", "cmd_vel:=/other")
        self.assertIn("/merlin_guard publishes /merlin/guard and serves merlin/stop already", text)
        self.assertEqual(self.witness.goals[goal], GoalStatus.ACTIVE)
        self.witness.state(PASSING)

    def test_a_node_that_publishes_past_the_guard_is_named(self):
        direct = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self.addCleanup(direct.unregister)
        text = f"{rospy.get_name()} publishes on /cmd_vel, past the guard"
        self.witness.wait(lambda: any(text in line for line in self.witness.log))
