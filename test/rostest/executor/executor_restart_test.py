# SPDX-License-Identifier: Apache-2.0
"""An Executor that was killed leaves goals behind: the next one removes them, and no others."""

import time
from pathlib import Path

import rospy
from executor_faults_case import EXECUTOR, FaultsCase

from merlin_planning.knowledge_client import ADD_GOAL, REMOVE_GOAL, Update, fact, knowledge_client
from merlin_planning.knowledge_text import to_pddl
from merlin_test import LONG

FOREIGN = fact("checked", "bathroom")
NOTED = f"{EXECUTOR}/added_goals"


class RestartCase(FaultsCase):
    def leave_a_goal(self):
        self.driving()
        knowledge_client().update([Update(ADD_GOAL, FOREIGN)])
        # Before it dies: moments later the knowledge base removes the goal of an owner that is gone.
        self.assertEqual(self.goals(), ["(checked kitchen)", "(checked bathroom)"])

    def restarted(self):
        """The goals that the next Executor leaves."""
        self.system.end_executor()
        self.start_executor()
        found = self.goals()
        knowledge_client().update([Update(REMOVE_GOAL, FOREIGN)])
        return found

    @staticmethod
    def goals():
        return [to_pddl(goal) for goal in knowledge_client().goals()]


class Restart(RestartCase):
    """Goals are noted in a file."""

    def test_with_a_new_master(self):
        self.leave_a_goal()
        if rospy.has_param(NOTED):
            rospy.delete_param(NOTED)  # nothing of the old master is left
        self.assertEqual(self.restarted(), ["(checked bathroom)"])

    def test_a_file_of_nonsense_is_ignored(self):
        self.system.end_executor()
        Path(self.usual()["goals_file"]).write_text("{3")
        knowledge_client().update([Update(ADD_GOAL, FOREIGN)])
        self.assertEqual(self.restarted(), ["(checked bathroom)"])


class RestartWithoutFile(RestartCase):
    """Goals are noted on the parameter server."""

    def usual(self):
        return {}

    def test_with_the_same_master(self):
        self.leave_a_goal()
        # Soon after; in a file, before.
        end = time.monotonic() + LONG
        while "(checked kitchen)" not in rospy.get_param(NOTED, []):
            assert time.monotonic() < end, "the goal is not noted"
            rospy.rostime.wallsleep(0.01)
        self.assertEqual(self.restarted(), ["(checked bathroom)"])
