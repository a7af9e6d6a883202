# SPDX-License-Identifier: Apache-2.0
"""The operator's side of the monitor's page, in Chromium: what hangs is said, and the robot obeys."""

import os
import signal
import subprocess

import rospy
from merlin_msgs.msg import ExecutorStatus, MissionStatus
from merlin_msgs.srv import Breakpoints, BreakpointsRequest
from monitor_fixture import OPERATOR, TOKEN, PageCases, Patrol
from monitor_process import parent_of
from std_srvs.srv import Trigger

from merlin_executor.executor_client import outcome_name
from merlin_test import LONG
from merlin_test.node_path import node_path
from merlin_test.process_signals import hang
from merlin_test.topic_links import pid_of

LONG_GOAL = "(and (checked kitchen) (checked bathroom) (checked dorm_room) (checked main_door))"
STATE_BREAKPOINTS = "merlin_fsm_host/state_breakpoints"


def clear_breakpoints():
    for name in ("merlin/breakpoints", "rosplan_plan_dispatcher/breakpoints", STATE_BREAKPOINTS):
        rospy.ServiceProxy(name, Breakpoints)(BreakpointsRequest.CLEAR, [])


class ControlCases(PageCases):
    def setUp(self):
        super().setUp()
        # A case that failed must not hold the robot for the others.
        for service in ("merlin/release", "merlin/resume"):
            rospy.ServiceProxy(service, Trigger)()

    # --- what is not known any more ------------------------------------------------------------------------

    def test_5_a_monitor_that_hangs_is_not_live(self):
        visit = self.operator()
        visit.wait_text("#connection", "live")
        hang(self.monitor.process.pid)
        try:
            visit.wait_text("#connection", "no news since")
            self.assertEqual(visit.page.evaluate("document.body.dataset.news"), "none")
        finally:
            self.monitor.process.send_signal(signal.SIGCONT)
        visit.wait_text("#connection", "live")
        self.knowledge.add_facts("(checked kitchen)")
        visit.wait_text("#knowledge-list .fact", "kitchen checked")

    def test_5_an_executor_that_hangs_or_is_gone_is_the_headline(self):
        visit = self.operator()
        doing = visit.text("#now-doing")
        pid = pid_of("/merlin_executor")
        hang(pid)
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
        hang(respawn)
        try:
            os.kill(pid, signal.SIGKILL)
            visit.wait_text("#now-doing", "not known: the Executor is gone")
        finally:
            os.kill(respawn, signal.SIGCONT)
        visit.wait_text("#now-doing", doing)
        visit.wait("() => !document.querySelector('[data-silent]')")
        # The next test talks to its new life.
        rospy.wait_for_service("merlin/resume", LONG)
        self.assertTrue(self.client.wait_for_executor(LONG))

    def test_5_a_server_that_hangs_is_named_in_the_headline(self):
        visit = self.operator()
        pid = pid_of("/merlin_fsm_host")
        hang(pid)
        try:
            visit.wait_text(
                "#now-trouble", "the process of the state machines (merlin_fsm_host) does not answer"
            )
        finally:
            os.kill(pid, signal.SIGCONT)
        visit.wait("() => document.getElementById('now-trouble').hidden")

    # --- control -------------------------------------------------------------------------------------------

    def test_6_goals_are_completed_checked_sent_and_cancelled(self):
        visit = self.visit()
        page = visit.page
        visit.wait_text("#knowledge-list", "travel time")
        page.click("#operator")
        page.fill("#token", "wrong")
        page.keyboard.press("Enter")
        visit.wait_text("#sign-in-said", "not the right one")
        self.assertEqual(self.status.message.state, ExecutorStatus.IDLE)
        visit.wait_text("#history-list .said", "wrong token from 127.0.0.1")
        page.fill("#token", TOKEN)
        page.keyboard.press("Enter")
        visit.wait_text("#operator", OPERATOR)
        goal = page.locator("#goal")
        goal.click()
        goal.press_sequentially("(che")
        visit.wait_text("#goal-choices li", "checked")
        page.keyboard.press("Tab")
        goal.press_sequentially("ki")
        visit.wait_text("#goal-choices li", "kitchen)")
        page.keyboard.press("Tab")
        self.assertEqual(goal.input_value(), "(checked kitchen)")
        page.fill("#goal", "(checked moon)")
        page.keyboard.press("Enter")
        visit.wait_text("#control-said", "moon")
        self.assertEqual(goal.input_value(), "(checked moon)")
        # The goals of the application, and those of a place, by what its operators achieve.
        visit.wait_text("#offered-goals button", "Ask in the kitchen")
        visit.wait("() => document.querySelector('.map-point[role=button][aria-label$=kitchen]')")
        page.focus(".map-point[aria-label$=kitchen]")
        page.keyboard.press("Enter")
        visit.wait("() => document.querySelectorAll('#place-list button').length >= 3")
        self.assertEqual(
            sorted(visit.texts("#place-list button")),
            ["Ask everybody", "Ask in the kitchen", "robot at kitchen"],
        )
        page.keyboard.press("Escape")
        page.fill("#goal", LONG_GOAL)
        self.drives.hold()
        page.get_by_role("button", name="Send goal").click()
        visit.wait_text("#control-said", "Sent as")
        visit.wait("() => document.getElementById('goal').value === ''")
        self.assertTrue(self.status.wait(lambda s: s.running and "(checked dorm_room)" in " ".join(s.goals)))
        self.assertEqual(self.status.message.by, OPERATOR)
        visit.wait_text("#now-because", f"asked for by {OPERATOR}")
        self.drives.wait_driving()
        page.fill("#goal", "(robot_at main_door)")  # while the robot drives it is nowhere
        page.click("#plan-only")
        visit.wait_text("#preview .left-out", "Begins when this has ended: ")
        visit.wait_text("#preview .title", "Not carried out: robot at main door ")
        page.locator("#queue-list .cancel").first.click()
        visit.wait_text("#now-last", "cancelled after")
        self.assertTrue(self.status.wait(lambda status: status.state == ExecutorStatus.IDLE))
        rooms = ("kitchen", "bathroom", "dorm_room", "main_door")
        self.assertFalse(all(self.knowledge.holds(f"(checked {room})") for room in rooms))

        events = visit.page.evaluate("async () => (await fetch('/history.json')).json()")
        mine = [event["text"] for event in events if event["detail"].get("by") == OPERATOR]
        self.assertTrue(any(text.startswith("Ana sends “kitchen checked") for text in mine), mine)
        self.assertTrue(any(text.startswith("Ana cancels ") for text in mine), mine)

    def test_6_an_unknown_request_cannot_be_cancelled(self):
        visit = self.operator()
        answer = visit.page.evaluate(
            """async (token) => {
              const answer = await fetch("/control/cancel", {
                method: "POST", headers: { "X-Merlin-Token": token }, body: '{"request": "/nobody-1"}' });
              return [answer.status, (await answer.json()).error];
            }""",
            TOKEN,
        )
        self.assertEqual(answer[0], 409)
        self.assertIn("no such request", answer[1])

    def test_6_a_plan_is_shown_and_not_carried_out(self):
        self.client.execute("(robot_at bathroom)", LONG)
        goals = self.knowledge.goals()
        visit = self.operator()
        page = visit.page
        page.fill("#goal", "(robot_at kitchen)")
        page.click("#plan-only")
        visit.wait_text("#preview .title", "Not carried out: robot at kitchen in ")
        step = page.locator("#preview li").first.get_attribute("title")
        self.assertIn("kitchen)", step)
        page.locator("#preview li button").first.click()
        visit.wait_text("#preview .left-out", step)
        steps = [each.get_attribute("title") for each in page.locator("#preview li").all()]
        self.assertTrue(steps)
        self.assertNotIn(step, steps)
        visit.wait_text(
            "#history-list .said", "Ana looks for a plan for “robot at kitchen” without navigating"
        )
        page.fill("#goal", "(and (robot_at kitchen) (robot_at bathroom))")
        page.click("#plan-only")
        visit.wait_text("#control-said[data-bad]", "no plan")
        # Nothing of it has reached the planning system's topics, its goals or the robot.
        self.assertEqual(self.knowledge.goals(), goals)
        self.assertEqual(self.status.message.state, ExecutorStatus.IDLE)
        page.locator("#preview .close").click()
        visit.wait("() => document.getElementById('preview').hidden")

    def test_6_facts_are_set_by_hand(self):
        before = self.knowledge.value("(travel_time kitchen bathroom)")
        self.addCleanup(self.knowledge.set_value, "(travel_time kitchen bathroom)", value=before)
        visit = self.operator()
        visit.page.fill("#goal", "(and (checked kitchen) (= (travel_time kitchen bathroom) 77))")
        visit.page.click("#set-facts")
        visit.wait_text("#control-said", "The knowledge was changed")
        self.assertTrue(self.knowledge.holds("(checked kitchen)"))
        self.assertEqual(self.knowledge.value("(travel_time kitchen bathroom)"), 77.0)
        visit.wait_text("#history-list .said", "Ana changes the knowledge: kitchen checked and")
        visit.wait_text("#undo", "not kitchen checked and")
        with visit.page.expect_response("**/control/change"):
            visit.page.click("#undo")
        self.assertFalse(self.knowledge.holds("(checked kitchen)"))
        self.assertEqual(self.knowledge.value("(travel_time kitchen bathroom)"), before)
        visit.page.fill("#goal", "(checked moon)")
        visit.page.click("#set-facts")
        visit.wait_text("#control-said[data-bad]", "moon")

    # --- breakpoints ---------------------------------------------------------------------------------------

    def hold_before(self, visit, text):
        visit.page.fill("#goal", text)
        visit.page.click("#hold-before")
        visit.wait_text("#breakpoints button", text)

    def test_6_a_plan_is_held_before_an_action_steps_and_goes_on(self):
        self.addCleanup(clear_breakpoints)
        self.client.execute("(robot_at bathroom)", LONG)
        visit = self.operator()
        self.hold_before(visit, "(navigate * kitchen)")
        request = self.client.send("(checked kitchen)")
        visit.wait_text("#now-doing", "held before navigating")
        visit.wait_text("#glance-state", "Held")
        self.assertTrue(self.status.wait(lambda status: status.held and not status.running))
        visit.page.click("#step")
        visit.wait_text("#now-doing", "held before asking")
        self.assertFalse(request.done)
        visit.page.click("#go-on")
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "SUCCEEDED", request.result.reason)
        for text in ("Ana holds the robot before (navigate * kitchen)", "Ana lets one action begin"):
            visit.wait_text("#history-list .said", text)
        visit.page.locator("#breakpoints button").first.click()
        visit.wait("() => !document.querySelector('#breakpoints button')")

    def test_6_what_is_held_is_cancelled_or_released_without_a_page(self):
        self.addCleanup(clear_breakpoints)
        visit = self.operator()
        self.hold_before(visit, "ask")
        request = self.client.send("(checked kitchen)")
        self.assertTrue(self.status.wait(lambda status: status.held == "(ask kitchen)"))
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "CANCELLED", request.result.reason)
        self.assertTrue(self.status.wait(lambda status: not status.held))
        self.hold_before(visit, "(checked kitchen)")
        request = self.client.send("(checked kitchen)")
        visit.wait_text("#now-doing", "held before kitchen checked")
        self.assertTrue(self.status.wait(lambda s: s.held and s.state == ExecutorStatus.IDLE))
        command = [node_path("merlin", "breakpoints")]
        said = subprocess.run(command, stdout=subprocess.PIPE, timeout=LONG, check=True).stdout.decode()
        self.assertIn("held before (checked kitchen)\n  (checked kitchen)\n  ask\n", said)
        subprocess.run([*command, "--clear"], timeout=LONG, check=True)
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "SUCCEEDED", request.result.reason)

    def test_6_a_machine_is_held_before_a_state_steps_and_is_cancelled(self):
        self.addCleanup(clear_breakpoints)
        self.client.execute("(robot_at bathroom)", LONG)
        visit = self.operator()
        visit.page.fill("#goal", "NAVIGATE/FLY")
        visit.page.click("#hold-before")
        visit.wait_text("#control-said[data-bad]", "no machine has a state NAVIGATE/FLY")
        self.hold_before(visit, "NAVIGATE/DRIVE")
        request = self.client.send("(robot_at kitchen)")
        visit.wait_text("#now-doing", "held before state DRIVE of NAVIGATE")
        visit.wait_text("#glance-state", "Held")
        visit.page.click("#step")
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "SUCCEEDED", request.result.reason)
        visit.wait_text("#history-list .said", "Ana lets the state NAVIGATE/DRIVE begin")
        request = self.client.send("(robot_at bathroom)")
        visit.wait_text("#now-doing", "held before state DRIVE of NAVIGATE")
        command = [node_path("merlin", "breakpoints")]
        said = subprocess.run(command, stdout=subprocess.PIPE, timeout=LONG, check=True).stdout.decode()
        self.assertIn("held before NAVIGATE/DRIVE\n  NAVIGATE/DRIVE\n", said)
        request.cancel()
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "CANCELLED", request.result.reason)
        visit.wait("() => !document.querySelector('#now-doing').textContent.includes('held')")
        # Left with an outcome, without being entered; the action counts as done.
        request = self.client.send("(robot_at bathroom)")
        visit.wait_text("#now-doing", "held before state DRIVE of NAVIGATE")
        visit.page.locator("#machine-list .machine[data-active=true] .node", has_text="DRIVE").first.focus()
        visit.page.keyboard.press("Enter")
        visit.page.get_by_role("button", name="Leave with succeeded").click()
        visit.wait_text("#control-said", "without being entered")
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "SUCCEEDED", request.result.reason)
        visit.wait_text("#history-list .said", "NAVIGATE/DRIVE left with succeeded, forced by Ana")
        visit.wait_text("#userdata .ran", "DRIVE → succeeded, forced by Ana")
        self.leave_on_a_terminal(visit)

    def leave_on_a_terminal(self, visit):
        """What the page does with a token, the robot's own terminal does without one."""

        def told(*words):
            done = subprocess.run(
                [node_path("merlin", words[0]), *words[1:]],
                capture_output=True,
                text=True,
                timeout=LONG,
                check=False,
            )
            return done.returncode, done.stdout + done.stderr

        request = self.client.send("(robot_at kitchen)")
        visit.wait_text("#now-doing", "held before state DRIVE of NAVIGATE")
        code, said = told("leave", "NAVIGATE/DRIVE", "flown")
        self.assertEqual((code, said.count("\n")), (2, 1), said)
        self.assertIn("merlin leave: ", said)
        self.assertIn("has no outcome 'flown'", said)
        code, said = told("leave", "NAVIGATE/DRIVE", "succeeded")
        self.assertEqual(code, 0, said)
        self.assertIn("without being entered", said)
        self.assertTrue(request.wait(LONG))
        self.assertEqual(outcome_name(request.result.outcome), "SUCCEEDED", request.result.reason)
        visit.wait_text("#history-list .said", "on a terminal")
        self.assertEqual(told("autonomy", "full"), (0, "The autonomy level is full.\n"))

    def test_7_a_pause_lets_the_goal_end_and_no_other_begin(self):
        visit = self.operator()
        page = visit.page
        self.drives.hold()
        mission, thread, ended = self.start_round(Patrol())
        self.addCleanup(mission.cancel)
        self.drives.wait_driving()
        page.click("#pause")
        self.assertTrue(self.status.wait(lambda status: status.paused))
        self.drives.hold()  # the next one
        visit.wait_text("#now-doing", "paused")
        self.assertTrue(self.status.wait(lambda status: status.state == ExecutorStatus.IDLE))
        visit.wait_text("#queue-note", "1 waiting")
        self.assertEqual(ended, [])
        visit.wait_text("#history-list .said", "Ana pauses")
        page.get_by_role("button", name="Resume").click()
        self.assertTrue(self.status.wait(lambda status: not status.paused and bool(status.running)))
        self.drives.wait_driving()
        # The mission survives a cancel: it waits until it is resumed.
        page.click("#cancel-all")
        visit.wait_text("#control-said", "cancel of all requests")
        visit.wait_text("#glance-state", "Paused")
        self.assertTrue(self.mission.wait(lambda status: status.state == MissionStatus.PAUSED))
        page.get_by_role("button", name="Resume").click()
        self.assertTrue(self.mission.wait(lambda status: status.state == MissionStatus.RUNNING))
        self.assertTrue(self.status.wait(lambda status: bool(status.running)))
        mission.cancel()
        thread.join(LONG)
        self.assertEqual(ended, [False])
