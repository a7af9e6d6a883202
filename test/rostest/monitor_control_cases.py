"""The operator's side of the monitor's page, in Chromium: what hangs is said, and the robot obeys."""

import os
import signal
import xmlrpc.client
from pathlib import Path

import rosgraph
import rospy
from merlin_msgs.msg import ExecutorStatus, GuardStatus, MissionStatus
from monitor_fixture import TOKEN, PageCases
from monitor_process import LONG
from std_srvs.srv import Trigger

from merlin_executor.executor_client import outcome_name

#: Takes long enough for a slow browser to find and press a button meanwhile.
LONG_GOAL = "(and (checked kitchen) (checked bathroom) (checked dorm_room) (checked main_door))"


def pid_of(node):
    uri = rosgraph.Master(rospy.get_name()).lookupNode(node)
    return xmlrpc.client.ServerProxy(uri).getPid(rospy.get_name())[2]


def parent_of(pid):
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


class ControlCases(PageCases):
    # --- what is not known any more ------------------------------------------------------------------------

    def test_5_a_monitor_that_hangs_is_not_live(self):
        visit = self.visit()
        visit.wait_text("#connection", "live")
        self.monitor.process.send_signal(signal.SIGSTOP)
        try:
            visit.wait_text("#connection", "no news since")
            self.assertEqual(visit.page.evaluate("document.body.dataset.news"), "none")
        finally:
            self.monitor.process.send_signal(signal.SIGCONT)
        visit.wait_text("#connection", "live")
        self.knowledge.add_facts("(checked kitchen)")
        visit.wait_text("#knowledge-list .fact", "(checked kitchen)")

    def test_5_an_executor_that_hangs_or_is_gone_is_the_headline(self):
        visit = self.visit()
        doing = visit.text("#now-doing")
        pid = pid_of("/merlin_executor")
        os.kill(pid, signal.SIGSTOP)
        try:
            visit.wait_text("#now-doing", "not known: the Executor does not answer")
            visit.wait_text("#queue .silent", "no news since")
            self.assertTrue(
                visit.page.evaluate("document.getElementById('queue').hasAttribute('data-silent')")
            )
        finally:
            os.kill(pid, signal.SIGCONT)
        visit.wait_text("#now-doing", doing)
        visit.wait("() => !document.querySelector('[data-silent]')")
        respawn = parent_of(pid)
        os.kill(respawn, signal.SIGSTOP)
        try:
            os.kill(pid, signal.SIGKILL)
            visit.wait_text("#now-doing", "not known: the Executor is gone")
        finally:
            os.kill(respawn, signal.SIGCONT)
        visit.wait_text("#now-doing", doing)
        visit.wait("() => !document.querySelector('[data-silent]')")

    def test_5_a_server_that_hangs_is_named_in_the_headline(self):
        visit = self.visit()
        pid = pid_of("/merlin_fsm_host")
        os.kill(pid, signal.SIGSTOP)
        try:
            visit.wait_text("#now-trouble", "merlin_fsm_host does not answer")
        finally:
            os.kill(pid, signal.SIGCONT)
        visit.wait("() => document.getElementById('now-trouble').hidden")

    # --- control -------------------------------------------------------------------------------------------

    def test_6_goals_are_completed_checked_sent_and_cancelled(self):
        visit = self.visit()
        page = visit.page
        visit.wait_text("#knowledge-list", "(travel_time")
        goal = page.locator("#goal")
        goal.click()
        goal.press_sequentially("(che")
        visit.wait_text("#goal-choices li", "checked")
        page.keyboard.press("Tab")
        goal.press_sequentially("ki")
        visit.wait_text("#goal-choices li", "kitchen)")
        page.keyboard.press("Tab")
        self.assertEqual(goal.input_value(), "(checked kitchen)")
        page.get_by_role("button", name="Send goal").click()
        visit.wait_text("#control-said", "A token is needed")
        page.fill("#token", "wrong")
        page.get_by_role("button", name="Send goal").click()
        visit.wait_text("#control-said", "not the right one")
        self.assertEqual(self.status.message.state, ExecutorStatus.IDLE)
        page.fill("#token", TOKEN)
        page.fill("#goal", "(checked moon)")
        page.keyboard.press("Enter")
        visit.wait_text("#control-said", "moon")
        page.fill("#goal", LONG_GOAL)
        page.get_by_role("button", name="Send goal").click()
        visit.wait_text("#control-said", "Sent as")
        self.assertTrue(self.status.wait(lambda status: bool(status.running)))
        self.assertIn("(checked dorm_room)", " ".join(self.status.message.goals))
        page.locator("#queue-list .cancel").first.click()
        visit.wait_text("#now-last", "cancelled after")
        self.assertTrue(self.status.wait(lambda status: status.state == ExecutorStatus.IDLE))
        self.assertTrue(
            any(not self.knowledge.holds(f"(checked {poi})") for poi in ("kitchen", "bathroom", "main_door"))
        )

    def test_7_a_mission_is_paused_and_resumed(self):
        visit = self.visit()
        visit.page.fill("#token", TOKEN)
        mission, thread, ended = self.start_round()
        visit.page.get_by_role("button", name="Pause the mission").click()
        self.assertTrue(self.mission.wait(lambda status: status.state == MissionStatus.PAUSED))
        resume = visit.page.get_by_role("button", name="Resume the mission")
        resume.wait_for()
        self.assertTrue(self.status.wait(lambda status: status.state == ExecutorStatus.IDLE))
        visit.wait_text("#now-doing", "paused")
        resume.click()
        self.assertTrue(self.mission.wait(lambda status: status.state == MissionStatus.RUNNING))
        mission.cancel()
        thread.join(LONG)
        self.assertEqual(ended, [False])
        with self.assertRaises(rospy.ServiceException):
            rospy.ServiceProxy("merlin/mission/pause", Trigger)()

    def test_7_the_stop_button_stops_the_base_until_its_release(self):
        visit = self.visit()
        page = visit.page
        page.set_viewport_size({"width": 390, "height": 800})
        page.locator("#stop").click()
        visit.wait_text("#control-said", "A token is needed")
        page.fill("#token", TOKEN)
        request = self.client.send(
            "(and (checked kitchen) (checked bathroom) (checked dorm_room) (checked main_door))"
        )
        self.assertTrue(self.guard.wait(lambda status: status.moving))
        page.locator("#stop").click()
        visit.wait_text("#guard-says", "The base is stopped")
        self.assertTrue(self.guard.wait(lambda status: status.state == GuardStatus.STOPPED))
        self.assertFalse(self.guard.message.moving)
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "CANCELLED", request.result.reason)
        result = self.client.execute("(checked bathroom)", LONG)
        self.assertEqual(outcome_name(result.outcome), "ACTION_FAILED")
        self.assertIn("has stopped the base", result.reason)
        page.locator("#release").click()
        visit.wait("() => document.getElementById('guard').hidden")
        result = self.client.execute("(checked bathroom)", LONG)
        self.assertEqual(outcome_name(result.outcome), "SUCCEEDED", result.reason)
