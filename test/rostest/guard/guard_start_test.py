# SPDX-License-Identifier: Apache-2.0
"""Guards that are started wrongly say so."""

import subprocess
import unittest

from guard_fixture import refused_guard

from merlin_test.node_path import node_path


class GuardStart(unittest.TestCase):
    def test_a_guard_whose_input_is_its_output_does_not_begin(self):
        text = refused_guard("__name:=loop", "__ns:=/side", "cmd_vel_in:=/other", "cmd_vel:=/other")
        self.assertIn("cmd_vel_in and cmd_vel are the same topic, /other", text)

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
