# SPDX-License-Identifier: Apache-2.0
"""Stop and hold on the monitor's page, in Chromium: the robot, its Executor and its mission obey."""

import os
import signal
import time

import rospy
from merlin_msgs.msg import ExecutorStatus, GuardStatus, MissionStatus
from monitor_control_cases import LONG_GOAL, ControlCases
from monitor_fixture import Patrol
from std_srvs.srv import Trigger

from merlin_executor.executor_client import outcome_name
from merlin_ros.actions.server_silence import CONNECTED_SILENCE
from merlin_test import LONG
from merlin_test.process_signals import hang
from merlin_test.topic_links import pid_of


class StopCases(ControlCases):
    def test_7_a_mission_survives_a_stop_and_goes_on_after_the_release(self):
        visit = self.operator()
        self.drives.hold()
        mission, thread, ended = self.start_round(Patrol())
        self.addCleanup(mission.cancel)
        self.drives.wait_driving()
        visit.page.click("#stop")
        visit.wait_text("#control-said", "confirmed by the guard")
        self.assertTrue(self.status.wait(lambda status: "the base is held by Ana since" in status.waits))
        self.assertTrue(self.mission.wait(lambda status: status.state == MissionStatus.PAUSED))
        visit.page.wait_for_selector("#pause", state="hidden")  # nothing is resumed beside a hold
        rospy.ServiceProxy("merlin/resume", Trigger)()
        self.assertEqual((self.status.message.state, ended), (ExecutorStatus.IDLE, []))
        visit.page.click("#release")
        self.assertTrue(self.mission.wait(lambda status: status.state == MissionStatus.RUNNING))
        self.assertTrue(self.guard.wait(lambda status: status.moving))
        mission.cancel()
        thread.join(LONG)
        self.assertEqual(ended, [False])

    def test_7_stop_and_hold_on_a_phone_while_the_executor_hangs(self):
        visit = self.visit(viewport={"width": 390, "height": 800})
        page = visit.page
        box = page.locator("#stop").bounding_box()
        self.assertGreater(box["width"], 300)
        self.assertGreaterEqual(box["height"], 60)
        request = self.client.send(LONG_GOAL)
        self.assertTrue(self.guard.wait(lambda status: status.moving))
        pid = pid_of("/merlin_executor")
        hangs_since = time.monotonic()
        hang(pid)
        try:
            page.click("#stop")  # without a token
            visit.wait_text("#control-said", "confirmed by the guard")
            self.assertTrue(self.guard.wait(lambda status: status.state == GuardStatus.STOPPED))
            self.assertFalse(self.guard.message.moving)
            self.assertEqual(self.guard.message.reason, "stopped by a visitor at 127.0.0.1")
            visit.wait_text("#now-doing", "stopped and held by a visitor at 127.0.0.1 since ")
            visit.wait_text("#now-because", "the Executor does not answer")
            visit.wait_text("#guard-says", "until it is released")
        finally:
            os.kill(pid, signal.SIGCONT)
            hung = time.monotonic() - hangs_since
        self.assertTrue(request.wait(LONG))
        # Its client gives up an Executor that hangs for longer: a busy machine draws the page so slowly.
        given_up = ["INTERNAL"] if hung > CONNECTED_SILENCE else []
        ends = ["CANCELLED", "ACTION_FAILED", *given_up]
        self.assertIn(outcome_name(request.result.outcome), ends, request.result.reason)
        # Another page says it too, and offers to release.
        other = self.operator()
        other.wait_text("#now-doing", "stopped and held by a visitor at 127.0.0.1 since ")
        self.assertEqual(self.guard.message.state, GuardStatus.STOPPED)
        other.page.click("#release")
        other.wait_text("#confirm-said", "held by a visitor at 127.0.0.1 since")
        other.page.click("#confirm-yes")
        self.assertTrue(self.guard.wait(lambda status: status.state == GuardStatus.IDLE))
        visit.wait("() => document.getElementById('guard').hidden")
        visit.wait_text("#history-list .said", "Ana releases the base")
        self.knowledge.remove_facts("(checked bathroom)")
        result = self.client.execute("(checked bathroom)", LONG)
        self.assertEqual(outcome_name(result.outcome), "SUCCEEDED", result.reason)

    def test_7_goals_that_are_sent_meanwhile_wait_for_the_release(self):
        visit = self.operator()
        self.drives.hold()
        running = self.client.send(LONG_GOAL)
        self.drives.wait_driving()
        visit.page.click("#stop")
        visit.wait_text("#control-said", "confirmed by the guard")
        self.assertTrue(running.wait(LONG))
        self.assertEqual(outcome_name(running.result.outcome), "CANCELLED", running.result.reason)
        self.assertTrue(self.status.wait(lambda status: bool(status.waits)))
        self.knowledge.remove_facts("(checked bathroom)")  # which may be where the robot was
        waiting = self.client.send("(checked bathroom)")
        visit.wait_text("#queue-note", "1 waiting")
        visit.page.click("#release")
        visit.wait_text("#control-said", "the next goal may begin")
        self.assertTrue(waiting.wait(LONG))
        self.assertEqual(outcome_name(waiting.result.outcome), "SUCCEEDED", waiting.result.reason)

    def test_7_a_stop_that_the_guard_does_not_confirm_is_reported(self):
        visit = self.operator()
        pid = pid_of("/merlin_guard")
        hang(pid)
        try:
            visit.page.click("#stop")
            visit.wait_text("#control-said[data-bad]", "NOT confirmed")
            visit.wait_text("#guard-says", "does not answer")
        finally:
            os.kill(pid, signal.SIGCONT)
        # The message reached it nevertheless, and it stops as soon as it runs.
        visit.wait_text("#now-doing", "stopped and held by Ana")
        self.assertTrue(self.status.wait(lambda status: status.paused))
        visit.page.click("#release")
        visit.wait("() => document.getElementById('guard').hidden")
        self.assertTrue(self.status.wait(lambda status: not status.paused))
