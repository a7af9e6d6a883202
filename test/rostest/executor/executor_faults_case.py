# SPDX-License-Identifier: Apache-2.0
"""One planning system and one Executor for all cases of executor_faults.test, until a case ends one."""

import shutil
import signal
import tempfile
import unittest

import rospy
from executor_faults_fixture import Guard, Watch, kill, start
from merlin_msgs.msg import DispatchStatus, ExecutorStatus

from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_planning.knowledge_client import KnowledgeClient
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.held_drives import HeldDrives

EXECUTOR = "/merlin_executor"
TOPICS = {
    "rosplan_planner_interface/problem_instance": "rosplan_problem_interface/problem_instance",
    "rosplan_parsing_interface/planner_output": "rosplan_planner_interface/planner_output",
    "rosplan_plan_dispatcher/complete_plan": "rosplan_parsing_interface/complete_plan",
}
CHECKED = [f"(checked {poi})" for poi in ("kitchen", "bathroom", "main_door")]


class System:
    """What the cases share: processes, and what they look through. It lives as long as the test's process."""

    def __init__(self):
        self.folder = tempfile.mkdtemp()
        self.drives = HeldDrives()
        self.dispatch = Watch("rosplan_plan_dispatcher/dispatch_status", DispatchStatus)
        self.status = Watch("merlin/status", ExecutorStatus)
        self.guard = Guard()
        self.planning = self.executor = None
        self.parameters = {}  # of the Executor that runs
        self.start_planning()
        self.knowledge = MerlinROSPlanAssistant()
        self.client = MerlinExecutorClient()
        rospy.on_shutdown(self.end)

    def start_planning(self):
        remaps = [f"{own}:={other}" for own, other in TOPICS.items()]
        self.planning = start("merlin_rosplan", "planning_system", "__name:=planning_system", *remaps)
        assert KnowledgeClient("rosplan_knowledge_base").wait(LONG)

    def start_executor(self, parameters):
        for name in set(self.parameters) - set(parameters):  # they stay for the next one
            rospy.delete_param(f"{EXECUTOR}/{name}")
        self.parameters = parameters
        given = [f"_{name}:={value}" for name, value in parameters.items()]
        self.executor = start("merlin_executor", "executor", f"__name:={EXECUTOR[1:]}", *given)
        assert self.client.wait_for_executor(LONG)

    def wait_executor_gone(self):
        """Until then a client may take one that was ended for alive: its connections end in other threads."""
        deadline = rospy.Time.now() + rospy.Duration(LONG)
        while self.client.executor_alive:
            assert rospy.Time.now() < deadline, "the executor that was ended seems to be alive"
            rospy.rostime.wallsleep(0.05)

    def end_executor(self, number=signal.SIGKILL):
        kill(self.executor, number)
        self.wait_executor_gone()

    @staticmethod
    def lives(process):
        return process is not None and process.poll() is None

    def end(self):
        for process in filter(self.lives, (self.executor, self.planning)):
            kill(process)
        shutil.rmtree(self.folder)


class FaultsCase(unittest.TestCase):
    """Begins with a planning system, an idle Executor, and a robot in the bathroom."""

    system = None

    @classmethod
    def setUpClass(cls):
        if FaultsCase.system is None:
            FaultsCase.system = System()
        cls.drives, cls.dispatch, cls.status = cls.system.drives, cls.system.dispatch, cls.system.status
        cls.knowledge, cls.guard, cls.client = cls.system.knowledge, cls.system.guard, cls.system.client

    @property
    def planning(self):
        return self.system.planning

    @property
    def executor(self):
        return self.system.executor

    def usual(self):
        """Parameters that most cases can share.

        What survives is noted, and a planning system may take its time to return.
        """
        return {"goals_file": f"{self.system.folder}/kept/goals", "planning_system_return": LONG}

    def setUp(self):
        self.guard.says(moving=False)
        self.guard.halted.clear()
        self.guard.braked.clear()
        if not self.system.lives(self.planning):
            self.system.start_planning()
        self.addCleanup(self.settle)
        self.addCleanup(self.drives.end)
        self.have_executor(**self.usual())
        self.knowledge.remove_facts([*CHECKED, *self.knowledge.facts("robot_at")])
        self.knowledge.add_facts("(robot_at bathroom)")  # so that the kitchen is a drive away

    def have_executor(self, **parameters):
        """Starts an Executor, unless one with these parameters runs."""
        if self.system.lives(self.executor):
            if self.system.parameters == parameters:
                return
            self.system.end_executor(signal.SIGTERM)
        self.system.start_executor(parameters)

    def start_executor(self):
        """Starts an Executor with the parameters of the last one."""
        self.system.start_executor(self.system.parameters)

    def settle(self):
        """Leaves an Executor to the next case that has nothing to do; else none."""
        if not self.system.lives(self.executor):
            return
        try:
            self.status.wait_idle(rospy.Time())
        except AssertionError:
            self.forget()
            raise

    def forget(self):
        """Ends the Executor and forgets what it has noted."""
        self.system.end_executor()
        shutil.rmtree(self.system.folder)
        self.system.folder = tempfile.mkdtemp()

    def driving(self, **options):
        """Has the kitchen checked; returns the request when the robot drives, until something stops it."""
        self.drives.hold()
        request = self.client.send("(checked kitchen)", **options)
        self.drives.wait_driving()
        return request

    def assertOutcome(self, result, name):
        self.assertEqual(outcome_name(result.outcome), name, result.reason)
