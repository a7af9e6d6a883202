# SPDX-License-Identifier: Apache-2.0
"""What tests of the monitor's page share: the browser, the topics to compare with, and a small mission."""

import contextlib
import os
import re
import tempfile
import threading
import unittest
from pathlib import Path

import rospkg
import rospy
from actionlib_msgs.msg import GoalStatusArray
from merlin_msgs.msg import ExecutorStatus, GuardStatus, KnowledgeChanges, MissionStatus
from monitor_process import Latest, Monitor

from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.mission.goal_dispatcher import GoalDispatcher
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_test import LONG
from merlin_test.chromium import Visit, chromium
from merlin_test.held_drives import HeldDrives

TOKEN = "token of the test"
OPERATOR = "Ana"
KB = "rosplan_knowledge_base"
#: What the page said of the last case is not said of the next one.
FORGET = """() => {
  document.activeElement?.blur();
  document.getElementById("confirm-ask").close();
  document.getElementById("goal").value = "";
  const said = document.getElementById("control-said");
  said.textContent = "";
  delete said.dataset.bad;
}"""

TABLES = "merlin_restaurant.tables_panel:TablesPanel"
BATTERY = "my_robot.battery_panel:BatteryPanel"
MANIFEST = """<package format="2"><name>my_robot</name><version>0.1.0</version>
<description>A robot.</description><maintainer email="me@example.org">Me</maintainer>
<license>BSD</license></package>"""


def robot_with_a_battery(folder):
    """The package that the README adds a panel with, and what the environment says of it."""
    readme = Path(rospkg.RosPack().get_path("merlin_monitor"), "README.md").read_text()
    python, javascript = re.findall(r"```(?:python|js)\n(.*?)```", readme, re.DOTALL)
    for name, text in (
        ("package.xml", MANIFEST),
        ("src/my_robot/__init__.py", ""),
        ("src/my_robot/battery_panel.py", python),
        ("web/battery.js", javascript),
    ):
        path = Path(folder, "my_robot", name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return {
        "ROS_PACKAGE_PATH": f"{folder}:{os.environ['ROS_PACKAGE_PATH']}",
        "PYTHONPATH": f"{folder}/my_robot/src:{os.environ['PYTHONPATH']}",
    }


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
        cls.stack = contextlib.ExitStack()
        folder = cls.stack.enter_context(tempfile.TemporaryDirectory())
        cls.monitor = Monitor([BATTERY, TABLES], robot_with_a_battery(folder))
        cls.monitor.start({OPERATOR: TOKEN})
        cls.browser = cls.stack.enter_context(chromium())
        PageCases.signed_in = None

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
        if self.signed_in:
            self.addCleanup(self.signed_in.complaints.clear)
        visits = [*self.visits, *filter(None, [self.signed_in])]
        complaints = [complaint for visit in visits for complaint in visit.complaints]
        for visit in self.visits:
            visit.close()
        self.assertEqual(complaints, [])

    def visit(self, **options):
        self.visits.append(Visit(self.browser, self.monitor.address, **options))
        return self.visits[-1]

    def operator(self):
        """The page on which the operator has signed in, one for all cases; it says nothing of the last."""
        visit = self.signed_in
        if visit is None:
            visit = Visit(self.browser, self.monitor.address)
            visit.page.click("#operator")
            visit.page.fill("#token", TOKEN)
            visit.page.keyboard.press("Enter")
            visit.wait_text("#operator", OPERATOR)
            PageCases.signed_in = visit
        else:
            visit.page.evaluate(FORGET)
        return visit

    def leave(self):
        """Closes the operator's page: the monitor is about to end."""
        if self.signed_in:
            self.signed_in.close()
        PageCases.signed_in = None

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
