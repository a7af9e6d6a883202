# SPDX-License-Identifier: Apache-2.0
"""Guards that are started wrongly say so."""

import subprocess
import unittest

import rospy
from guard_fixture import refused_guard

from merlin_test.node_path import node_path


class GuardStart(unittest.TestCase):
    def test_a_guard_whose_input_is_its_output_does_not_begin(self):
        text = refused_guard("__name:=loop", "__ns:=/side", "cmd_vel_in:=/other", "cmd_vel:=/other")
        self.assertIn("cmd_vel_in and cmd_vel are the same topic, /other", text)

    def test_parameters_that_cannot_be_used_are_named(self):
        for argument, text in (
            ("_cancel_deadline:=soon", "~cancel_deadline is 'soon'"),
            ("_command_timeout:=-1", "~command_timeout is -1"),
            ("_motion_servers:=move_base", "~motion_servers is 'move_base'; it has to be a list"),
            ("_motion_servers:=[3]", "~motion_servers has 3"),
            ("_motion_servers:=[]", "~motion_servers is []"),
            ("_require_lease:=perhaps", "~require_lease is 'perhaps'"),
            ("_stop_button:=-3", "~stop_button is -3"),
            ("_max_speed:=0", "~max_speed is 0; it has to be a number, more than 0"),
            ("_max_turn_speed:=fast", "~max_turn_speed is 'fast'"),
            ("_over_limit:=brake", "~over_limit is 'brake'; it has to be clamp or refuse"),
            ("_suspend_after:=9.0", "suspend_after (9 s) is longer than lose_after (3 s)"),
        ):
            found = refused_guard("__name:=wrong", "cmd_vel:=/other", argument)
            self.assertIn(text, found)
            rospy.delete_param("/wrong")

    def test_a_motion_server_that_does_not_exist_is_named(self):
        guard = [node_path("merlin_guard", "guard"), "__ns:=/side", "__name:=dock", "cmd_vel_in:=/other"]
        process = subprocess.Popen(
            [*guard, "_motion_servers:=[/move_base, /dock]", "_server_wait:=1.0"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)
        said = []
        while not any("no motion server /dock after 1 s" in line and "/move_base" in line for line in said):
            said.append(process.stdout.readline())
            self.assertTrue(said[-1], said)
