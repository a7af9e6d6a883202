# SPDX-License-Identifier: Apache-2.0
"""What tests of the monitor's page share: the browser, the topics to compare with, and a small mission."""

import contextlib
import threading
import unittest

import rospy
from actionlib_msgs.msg import GoalStatusArray
from merlin_msgs.msg import ExecutorStatus, GuardStatus, KnowledgeChanges, MissionStatus
from monitor_process import LONG, Latest, Monitor

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.mission.goal_dispatcher import GoalDispatcher
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test.chromium import Visit, chromium
from merlin_test.held_drives import HeldDrives

TOKEN = "token of the test"
OPERATOR = "Ana"
KB = "rosplan_knowledge_base"


class Round(GoalDispatcher):
    def run(self):
        for poi in ("kitchen", "bathroom", "main_door"):
            self.achieve(f"(checked {poi})")


class Patrol(GoalDispatcher):
    """Goes on until it is cancelled, however slow the browser is."""

    def run(self):
        while True:
            for poi in ("kitchen", "bathroom"):
                self.achieve(f"(robot_at {poi})")


class PageCases(unittest.TestCase):
    """A page in a browser, over all of MERLIN on simulated servers."""

    @classmethod
    def setUpClass(cls):
        # The nodes begin together with this test.
        for service in ("update_array", "query_state", "state/propositions", "state/goals"):
            rospy.wait_for_service(f"{KB}/{service}", LONG)
        cls.client = MerlinExecutorClient()
        assert cls.client.wait_for_executor(LONG), "no executor"
        for action in ("navigate", "ask"):
            rospy.wait_for_message(f"actions/{action}/status", GoalStatusArray, LONG)
        cls.knowledge = MerlinROSPlanAssistant()
        cls.status = Latest("merlin/status", ExecutorStatus)
        cls.mission = Latest("merlin/mission", MissionStatus)
        cls.guard = Latest("merlin/guard", GuardStatus)
        cls.changes = Latest(f"{KB}/changes", KnowledgeChanges)
        assert cls.status.wait(lambda status: status.state == ExecutorStatus.IDLE), "no status"
        cls.drives = HeldDrives()  # a drive lasts until the page, however slow, has shown it or stopped it
        cls.monitor = Monitor()
        cls.monitor.start({OPERATOR: TOKEN})
        cls.stack = contextlib.ExitStack()
        cls.browser = cls.stack.enter_context(chromium())

    @classmethod
    def tearDownClass(cls):
        cls.stack.close()
        cls.monitor.stop()

    def setUp(self):
        self.addCleanup(self.drives.end)
        self.visits = []
        for poi in ("kitchen", "bathroom", "dorm_room", "main_door"):
            self.knowledge.remove_facts(f"(checked {poi})")

    def tearDown(self):
        complaints = [complaint for visit in self.visits for complaint in visit.complaints]
        for visit in self.visits:
            visit.close()
        self.assertEqual(complaints, [])

    def visit(self, **options):
        self.visits.append(Visit(self.browser, self.monitor.address, **options))
        return self.visits[-1]

    def operator(self, **options):
        """A page on which the operator has signed in."""
        visit = self.visit(**options)
        visit.page.click("#operator")
        visit.page.fill("#token", TOKEN)
        visit.page.keyboard.press("Enter")
        visit.wait_text("#operator", OPERATOR)
        return visit

    def start_round(self, mission=None):
        mission = mission or Round(tasks=3)
        ended = []

        def execute():
            ended.append(mission.execute())
            with self.status.changed:
                self.status.changed.notify_all()

        thread = threading.Thread(target=execute, daemon=True)
        thread.start()
        self.assertTrue(self.status.wait(lambda status: bool(status.running)))
        return mission, thread, ended
