#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""An Executor that was killed leaves goals behind: the next one removes them, and no others."""

import os
import shutil
import signal
import subprocess
import tempfile
import time
import unittest
from pathlib import Path

import rospy

import rostest
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_planning.knowledge_client import ADD_GOAL, REMOVE_GOAL, Update, fact, knowledge_client
from merlin_planning.knowledge_text import to_pddl
from merlin_test.node_path import node_path
from merlin_test.topic_links import init_node

LONG = 60.0
FOREIGN = fact("checked", "bathroom")
NOTED = "/merlin_executor/added_goals"


class ExecutorRestart(unittest.TestCase):
    def setUp(self):
        folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, folder)
        self.file = Path(folder) / "kept" / "goals"
        self.knowledge = knowledge_client()
        self.assertTrue(self.knowledge.wait(LONG))
        self.executor = None
        self.addCleanup(lambda: self.executor is None or self.kill())
        if rospy.has_param("/merlin_executor/goals_file"):
            rospy.delete_param("/merlin_executor/goals_file")  # of an earlier test

    def start(self, *parameters):
        self.executor = subprocess.Popen(
            [node_path("merlin_executor", "executor"), *parameters], start_new_session=True
        )
        self.client = MerlinExecutorClient()
        self.assertTrue(self.client.wait_for_executor(LONG))
        return self.client

    def kill(self):
        os.killpg(self.executor.pid, signal.SIGKILL)
        self.executor.wait()
        self.executor = None
        # Its connections end in threads of their own: until then a new client may take it for alive.
        end = time.monotonic() + LONG
        while self.client.executor_alive:
            assert time.monotonic() < end, "the killed executor seems to be alive"
            rospy.rostime.wallsleep(0.01)

    def goals(self):
        return [to_pddl(goal) for goal in self.knowledge.goals()]

    def leave_a_goal(self, *parameters):
        request = self.start(*parameters).send("(checked kitchen)")
        while "(checked kitchen)" not in self.goals():
            self.assertFalse(request.wait(0.0), request.result)
            rospy.rostime.wallsleep(0.01)
        self.knowledge.update([Update(ADD_GOAL, FOREIGN)])
        # Before it dies: moments later the knowledge base removes the goal of an owner that is gone.
        self.assertEqual(self.goals(), ["(checked kitchen)", "(checked bathroom)"])
        # On the parameter server it is noted soon after; in a file, before.
        end = time.monotonic() + LONG
        while not parameters and "(checked kitchen)" not in rospy.get_param(NOTED, []):
            assert time.monotonic() < end, "the goal is not noted"
            rospy.rostime.wallsleep(0.01)
        self.kill()

    def restarted(self, *parameters):
        self.start(*parameters)
        found = self.goals()
        self.knowledge.update([Update(REMOVE_GOAL, FOREIGN)])
        return found

    def test_with_the_same_master(self):
        self.leave_a_goal()
        self.assertEqual(self.restarted(), ["(checked bathroom)"])

    def test_with_a_new_master(self):
        noted = f"_goals_file:={self.file}"
        self.leave_a_goal(noted)
        if rospy.has_param(NOTED):
            rospy.delete_param(NOTED)  # nothing of the old master is left
        self.assertEqual(self.restarted(noted), ["(checked bathroom)"])

    def test_a_file_of_nonsense_is_ignored(self):
        self.file.parent.mkdir()
        self.file.write_text("{3")
        self.knowledge.update([Update(ADD_GOAL, FOREIGN)])
        self.assertEqual(self.restarted(f"_goals_file:={self.file}"), ["(checked bathroom)"])


if __name__ == "__main__":
    init_node("executor_restart_test")
    rostest.rosrun("merlin_test", "executor_restart", ExecutorRestart)
