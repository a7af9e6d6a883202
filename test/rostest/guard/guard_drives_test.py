# SPDX-License-Identifier: Apache-2.0
"""Drives that go wrong though nothing forbids them, and velocities that no base may get."""

import threading

import actionlib
import rospy
from geometry_msgs.msg import PoseStamped, Twist
from guard_case import PASSING, GuardCase
from move_base_msgs.msg import MoveBaseAction
from nav_msgs.msg import Odometry

from merlin_sm.states.merlin_state import ABORTED
from merlin_sm.states.navigation import NavigationState
from merlin_test import LONG


class GuardDrives(GuardCase):
    def test_a_velocity_above_the_limits_does_not_pass_as_it_is(self):
        self.drive()
        fast = Twist()
        fast.linear.x, fast.angular.z = 1e300, 2e300
        self.witness.fastest, before = 0.0, self.witness.status.limited
        self.commands.publish(fast)
        self.warned("a velocity is above the limits, and less is sent instead: 1e+300 m/s")
        self.assertGreater(self.witness.status.limited, before)
        self.witness.forget()
        self.commands.publish(fast)
        self.witness.wait(lambda: len(self.witness.velocities) > 5)
        self.assertLessEqual(self.witness.fastest, 2.0 + 1e-6)
        text = "a velocity is above the limits"
        self.witness.wait(lambda: any(text in line for line in self.witness.log))

    def warned(self, text):
        self.witness.wait(lambda: text in self.witness.status.warning)

    def server(self, name):
        """A plain action server of this process; its goals end when a test says so."""
        goals = []
        server = actionlib.ActionServer(
            name,
            MoveBaseAction,
            lambda goal: (goal.set_accepted(), goals.append(goal)),
            lambda goal: goal.set_canceled(),
            auto_start=False,
        )
        server.start()
        self.addCleanup(server.stop)
        self.addCleanup(lambda: [goal.set_succeeded() for goal in goals])
        return goals

    def run_state(self, action):
        """A navigation state that runs; returns it, and what waits for its outcome."""
        state, outcomes = NavigationState(target=PoseStamped(), action=action), []
        driver = threading.Thread(target=lambda: outcomes.append(state.execute(None)), daemon=True)
        driver.start()

        def outcome():
            driver.join(LONG)
            return outcomes[0]

        return state, outcome

    def test_a_drive_of_a_server_that_the_guard_does_not_know_does_not_begin(self):
        goals = self.server("crane")
        state, outcome = self.run_state("crane")
        self.assertEqual((outcome(), goals), (ABORTED, []))
        self.assertEqual(
            state.reason,
            "the velocity guard passes no velocities of /crane: it is not among its motion_servers "
            "[/move_base, /dock]",
        )

    def test_a_drive_without_velocities_is_named_and_goes_on(self):
        goals = self.server("dock")
        _, outcome = self.run_state("dock")
        self.warned("/dock has an active goal and has sent no velocity on /cmd_vel_in for 1 s")
        goals.pop().set_succeeded()
        self.assertEqual(outcome(), "succeeded")
        self.witness.wait(lambda: not self.witness.status.warning)

    def test_a_base_that_does_not_move_is_named(self):
        odometry = rospy.Publisher("odom", Odometry, queue_size=1)
        self.addCleanup(odometry.unregister)
        self.witness.wait(odometry.get_num_connections)
        self.drive()

        def stuck():
            odometry.publish(Odometry())
            return "/move_base drives, and the base does not move" in self.witness.status.warning

        self.witness.wait(stuck)  # which is asked at each velocity
        self.witness.state(PASSING)
