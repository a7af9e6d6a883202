#!/usr/bin/env python3
"""The monitor's page in Chromium, beside the ROS topics it shows."""

import contextlib
import os
import signal
import threading
import time
import unittest
import xmlrpc.client
from pathlib import Path

import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatusArray
from chromium import Visit, chromium
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseArray
from merlin_msgs.msg import ExecutorStatus, GuardStatus, KnowledgeChanges, MissionStatus
from monitor_process import LONG, Latest, Monitor
from nav_msgs.msg import OccupancyGrid
from rosplan_knowledge_msgs.msg import KnowledgeItem
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure
from std_srvs.srv import Trigger

import rostest
from merlin_executor.executor_client import MerlinExecutorClient, outcome_name
from merlin_executor.mission.goal_dispatcher import GoalDispatcher
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

TOKEN = "test token"
KB = "rosplan_knowledge_base"
HOSTILE = '<img src=x onerror="window.pwned=1"><script>window.pwned=1</script>\'";alert(1)//'


def pid_of(node):
    uri = rosgraph.Master(rospy.get_name()).lookupNode(node)
    return xmlrpc.client.ServerProxy(uri).getPid(rospy.get_name())[2]


def parent_of(pid):
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


class Round(GoalDispatcher):
    def run(self):
        for poi in ("kitchen", "bathroom", "main_door"):
            self.achieve(f"(checked {poi})")


class MonitorPage(unittest.TestCase):
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
        cls.monitor = Monitor()
        cls.monitor.start(TOKEN)
        cls.stack = contextlib.ExitStack()
        cls.browser = cls.stack.enter_context(chromium())

    @classmethod
    def tearDownClass(cls):
        cls.stack.close()
        cls.monitor.stop()

    def setUp(self):
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

    def start_round(self):
        mission = Round(tasks=3)
        ended = []

        def execute():
            ended.append(mission.execute())
            with self.status.changed:
                self.status.changed.notify_all()

        thread = threading.Thread(target=execute, daemon=True)
        thread.start()
        self.assertTrue(self.status.wait(lambda status: bool(status.running)))
        return mission, thread, ended

    # --- what is shown -------------------------------------------------------------------------------------

    def test_1_the_page_says_what_the_topics_say_throughout_a_mission(self):
        visit = self.visit()
        visit.wait_text("#knowledge-list", "(travel_time kitchen bathroom)")
        _, thread, ended = self.start_round()
        agreed = set()
        while self.status.wait(lambda status: bool(status.running) or ended) and not ended:
            status = self.status.message
            if not status.running:
                continue  # the action ended just now
            action = status.running[0]
            wanted = f"({' '.join([action.name, *(pair.value for pair in action.parameters)])})"
            end = time.monotonic() + LONG
            while self.status.message is status:
                shown = visit.now()
                if self.status.message is not status:
                    break  # the robot was faster than the look at the page
                if shown.get("action") == wanted and shown.get("goal") == status.goals[0]:
                    self.assertIn("Round, task", shown["mission"])
                    self.assertIn(f"because {status.goals[0]} was requested by Round", shown["because"])
                    agreed.add(wanted)
                    break
                self.assertLess(time.monotonic(), end, f"{shown} is not {wanted}")
            self.status.wait(lambda latest, seen=status: latest is not seen or ended)
        thread.join(LONG)
        self.assertEqual(ended, [True])
        self.assertGreaterEqual(len(agreed), 3, agreed)
        visit.wait_text("#now-doing", "Round has ended")
        visit.wait(
            "() => [...document.querySelectorAll('#plan-steps li')]"
            ".every((step) => step.dataset.state === 'succeeded')"
        )
        visit.wait_text(".machine[data-active=false] .where", "ended with succeeded")
        # The knowledge is that of the knowledge base, and says who changed it.
        held = {f"(checked {poi})" for poi in ("kitchen", "bathroom", "main_door")}
        held |= {"(robot_at main_door)", "(in_service)"}
        for fact in held:
            visit.wait_text("#knowledge-list .fact", fact)
        state = visit.page.evaluate("async () => (await (await fetch('/state.json')).json()).state")
        self.assertEqual(set(state["knowledge"]["facts"]), held)
        self.assertEqual(state["knowledge"]["facts"]["(checked kitchen)"]["by"], "/merlin_bridges")
        texts = " ".join(visit.texts("#history-list .said"))
        for wanted in (
            "Round running, task 1 of 3",
            "(checked kitchen): succeeded",
            "plan of 2 steps",
            "(ask kitchen) succeeded",
        ):
            self.assertIn(wanted, texts)
        ranges = visit.texts("#health-list .title")
        self.assertIn("merlin_executor: requests", ranges)

    def test_2_search_userdata_and_keyboard(self):
        visit = self.visit(viewport={"width": 390, "height": 800})
        visit.wait_text("#knowledge-list", "(travel_time anywhere bathroom)")
        visit.page.keyboard.press("/")
        visit.page.keyboard.type("travel_time kitchen BATH")
        visit.wait("() => [...document.querySelectorAll('.fact')].filter(x => !x.hidden).length === 2")
        rows = visit.page.locator(".fact:visible .text").all_text_contents()
        self.assertEqual(sorted(rows), ["(travel_time bathroom kitchen)", "(travel_time kitchen bathroom)"])
        visit.page.keyboard.press("Escape")
        visit.page.keyboard.press("4")
        self.assertEqual(visit.page.evaluate("document.activeElement.id"), "machines")
        visit.wait_text(".node.state", "DRIVE")
        node = visit.page.locator(".node.state", has_text="DRIVE")
        node.focus()
        visit.page.keyboard.press("Enter")
        visit.wait_text("#userdata .title", "Userdata of /NAVIGATE")
        overflow = visit.page.evaluate("document.documentElement.scrollWidth > window.innerWidth")
        self.assertFalse(overflow, "a phone would have to be scrolled sideways")

    def test_3_hostile_names_are_shown_as_text(self):
        visit = self.visit()
        visit.wait_text("#knowledge-list", "(travel_time")
        publishers = {}

        def publish(topic, kind, message, latch=True):
            publishers[topic] = rospy.Publisher(topic, kind, latch=latch, queue_size=5)
            publishers[topic].publish(message)

        status = DiagnosticStatus(name=HOSTILE, message=HOSTILE, level=DiagnosticStatus.ERROR)
        publish("/diagnostics", DiagnosticArray, DiagnosticArray(status=[status]))
        publish(
            "evil/smach/container_structure",
            SmachContainerStructure,
            SmachContainerStructure(
                path=f"/{HOSTILE.replace('/', '')}",
                children=[HOSTILE.replace("/", ""), "__proto__"],
                internal_outcomes=[HOSTILE],
                outcomes_from=["__proto__"],
                outcomes_to=["None"],
                container_outcomes=[HOSTILE],
            ),
        )
        publish(
            "evil/smach/container_status",
            SmachContainerStatus,
            SmachContainerStatus(
                path=f"/{HOSTILE.replace('/', '')}", active_states=["__proto__"], local_data=HOSTILE
            ),
        )
        publish("merlin/mission", MissionStatus, MissionStatus(mission=HOSTILE, description=HOSTILE, state=1))
        item = KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name=HOSTILE)
        before = self.changes.message.version if self.changes.message else 0
        publish(
            f"{KB}/changes",
            KnowledgeChanges,
            KnowledgeChanges(version=before + 1, client=HOSTILE, added=[item]),
            latch=False,
        )
        rospy.set_param("world/points_of_interest/evil", {"x": 0.0, "y": 0.0})
        for selector in (
            "#health-list .title",
            "#health-list .more",
            "#now-chain",
            "#history-list .said",
            ".machine .name",
        ):
            visit.wait_text(selector, HOSTILE.replace("/", "") if "machine" in selector else HOSTILE)
        visit.wait_text(".machine .graph text", HOSTILE.replace("/", "")[:20])
        visit.wait_text(".map-point text", "evil")
        end = time.monotonic() + LONG
        while HOSTILE not in " ".join(visit.texts("#knowledge-recent .text")):
            self.assertLess(time.monotonic(), end)
            publishers[f"{KB}/changes"].publish(
                KnowledgeChanges(version=before + 1, client=HOSTILE, added=[item])
            )
            time.sleep(0.1)
        self.assertIsNone(visit.page.evaluate("window.pwned ?? null"))
        self.assertEqual(visit.page.locator("main img, main script").count(), 0)
        for publisher in publishers.values():
            publisher.unregister()
        # The next change of the knowledge base shows the gap, and all is read again.
        self.knowledge.add_facts("(checked dorm_room)")
        visit.wait(
            "async (hostile) => {"
            " const { facts } = (await (await fetch('/state.json')).json()).state.knowledge;"
            " return '(checked dorm_room)' in facts"
            " && !Object.keys(facts).some((key) => key.includes(hostile)); }",
            HOSTILE,
        )

    def test_4_the_map_shows_who_is_where(self):
        visit = self.visit()
        grid = OccupancyGrid(data=[100, 0, 0, -1])
        grid.header.frame_id = "map"
        grid.info.width, grid.info.height, grid.info.resolution = 2, 2, 1.0
        maps = rospy.Publisher("/map", OccupancyGrid, latch=True, queue_size=1)
        maps.publish(grid)
        people = rospy.Publisher("people", PoseArray, latch=True, queue_size=1)
        people.publish(PoseArray(poses=[Pose(position=Point(0.5, 1.5, 0.0))]))
        visit.wait("() => document.querySelectorAll('.map-person').length === 1")
        self.assertIn("translate(0.5 -1.5)", visit.page.get_attribute(".map-person", "transform"))
        visit.wait(
            "() => (document.querySelector('#map image').getAttribute('href') || '').startsWith('/map.png')"
        )
        visit.wait_text(".map-point text", "kitchen")
        self.assertEqual(visit.page.evaluate("async () => (await fetch('/map.png')).status"), 200)
        maps.unregister()
        people.unregister()

    def test_5_ten_pages_see_a_change(self):
        first = self.visit()
        visits = [first, *(self.visit(beside=first) for _ in range(9))]
        self.knowledge.add_facts("(checked kitchen)")
        for visit in visits:
            visit.wait_text("#knowledge-list .fact", "(checked kitchen)")
        self.knowledge.remove_facts("(checked kitchen)")
        for visit in visits:
            visit.wait(
                "() => ![...document.querySelectorAll('.fact')]"
                ".some((row) => !row.hidden && row.textContent.includes('(checked kitchen)'))"
            )

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
        # Long enough for a slow browser to find the button.
        page.fill(
            "#goal", "(and (checked kitchen) (checked bathroom) (checked dorm_room) (checked main_door))"
        )
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
        request = self.client.send("(checked dorm_room)")
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

    # --- again ---------------------------------------------------------------------------------------------

    def test_8_the_page_comes_back_when_the_node_does_and_keeps_the_history(self):
        visit = self.visit(color_scheme="dark")
        visit.wait_text("#connection", "live")
        # More events than the page is given at once.
        parts = [
            DiagnosticStatus(name=f"part {number}", level=DiagnosticStatus.WARN) for number in range(250)
        ]
        diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, latch=True, queue_size=1)
        diagnostics.publish(DiagnosticArray(status=parts))
        visit.wait_text("#history-list .said", "part 249: warning")
        diagnostics.unregister()
        self.knowledge.add_facts("(checked bathroom)")
        visit.choose_kinds("knowledge")
        visit.wait_text("#history-list .said", "(checked bathroom) added")
        self.assertLess(self.monitor.stop(), 10.0)
        visit.wait_text("#connection", "no news since")
        self.monitor.start("")
        visit.wait_text("#connection", "live")
        visit.wait_text("#knowledge-list .fact", "(checked bathroom)")
        self.knowledge.add_facts("(checked kitchen)")
        visit.wait_text("#knowledge-list .fact", "(checked kitchen)")

        # A new page sees what was before it, back to the first event.
        visit = self.visit()
        events = visit.page.evaluate("async () => (await fetch('/history.json')).json()")
        self.assertGreater(len(events), 250)
        visit.choose_kinds("mission", "goal", "action")
        wanted = [event["text"] for event in events if event["kind"] in ("mission", "goal", "action")][::-1]
        visit.wait_text("#history-list .run", "an earlier run")
        # Scrolling to the end of the list is what makes it longer.
        visit.wait(
            "(count) => { const list = document.getElementById('history-list'); list.scrollTop = 1e6;"
            " return list.querySelectorAll('.said').length >= count; }",
            len(wanted),
        )
        self.assertEqual(visit.texts("#history-list .said"), wanted)
        self.assertTrue(any(text.startswith("(checked kitchen): succeeded") for text in wanted))

        # Started without a token, it only shows.
        visit.wait("() => document.getElementById('control').hidden")
        answer = visit.page.evaluate(
            "async () => { const answer = await fetch('/control/pause', {method: 'POST'});"
            " return [answer.status, await answer.text()]; }"
        )
        self.assertEqual(answer[0], 403)
        self.assertIn("read-only", answer[1])


if __name__ == "__main__":
    rospy.init_node("monitor_test")
    rostest.rosrun("merlin_test", "monitor", MonitorPage)
