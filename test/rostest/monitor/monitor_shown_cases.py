# SPDX-License-Identifier: Apache-2.0
"""The monitor's page in Chromium, beside the ROS topics it shows."""

import time

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseArray
from merlin_msgs.msg import KnowledgeChanges, MissionStatus
from monitor_fixture import KB, PageCases
from nav_msgs.msg import OccupancyGrid
from rosplan_knowledge_msgs.msg import KnowledgeItem
from sensor_msgs.msg import BatteryState
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure

from merlin_monitor.text.phrase import in_english
from merlin_monitor.text.wording import Wording
from merlin_test import LONG

HOSTILE = '<img src=x onerror="window.pwned=1"><script>window.pwned=1</script>\'";alert(1)//'

#: What fleet.launch sets, of a hub that is not there.
FLEET = {
    "merlin_fleet": {"fleet": "lab", "hub": "127.0.0.1:1"},
    "merlin/panels/fleet": "merlin_fleet.node.fleet_panel:FleetPanel",
}


class ShownCases(PageCases):
    def test_1_the_page_says_what_the_topics_say_throughout_a_mission(self):
        visit = self.visit()
        visit.wait_text("#knowledge-list", "travel time of kitchen, bathroom")
        self.drives.hold()
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
                place = status.goals[0].strip("()").split()[1].replace("_", " ")
                said = {
                    "action pddl": wanted,
                    "goal pddl": status.goals[0],
                    "goal": f"{place} checked",
                    "because": f"for “{place} checked”, asked for by Round",
                }
                # The page hears of the mission by another topic, at first perhaps later.
                if said.items() <= shown.items() and "Round, task" in shown.get("mission", ""):
                    if action.name == "navigate" and wanted not in agreed:
                        self.drives.wait_driving()  # the page may be faster than the base
                        self.drives.hold()  # the next one
                    agreed.add(wanted)
                    break
                self.assertLess(time.monotonic(), end, f"{shown} is not {said}")
            self.assertTrue(self.status.wait(lambda latest, seen=status: latest is not seen or ended))
        thread.join(LONG)
        self.assertEqual(ended, [True])
        self.assertGreaterEqual(len(agreed), 3, agreed)
        visit.wait_text("#now-doing", "Round has ended")
        visit.wait(
            "() => [...document.querySelectorAll('#plan-steps li')]"
            ".every((step) => step.dataset.state === 'succeeded')"
        )
        visit.wait_text(".machine[data-active=false] .where", "ended with succeeded")
        # The knowledge is that of the knowledge base, and names the client that changed it.
        held = {f"(checked {poi})" for poi in ("kitchen", "bathroom", "main_door")}
        held |= {"(robot_at main_door)", "(in_service)"}
        for fact in held:
            visit.wait_text("#knowledge-list .fact", in_english(Wording().fact(fact)))
        state = visit.page.evaluate("async () => (await (await fetch('/state.json')).json()).state")
        self.assertEqual(set(state["knowledge"]["facts"]), held)
        self.assertEqual(state["knowledge"]["facts"]["(checked kitchen)"]["by"], "/merlin_bridges")
        texts = " ".join(visit.texts("#history-list .said"))
        for wanted in (
            "Round running, task 1 of 3",
            "“kitchen checked”: succeeded",
            "plan of 2 steps",
            "asking at the kitchen: succeeded",
        ):
            self.assertIn(wanted, texts)
        ranges = visit.texts("#health-list .title")
        self.assertIn("merlin_executor: requests", ranges)

    def test_2_search_userdata_and_keyboard(self):
        visit = self.visit(viewport={"width": 390, "height": 800})
        visit.wait_text("#knowledge-list", "travel time of anywhere, bathroom")
        visit.page.keyboard.press("/")
        visit.page.keyboard.type("travel_time kitchen BATH")
        visit.wait("() => [...document.querySelectorAll('.fact')].filter(x => !x.hidden).length === 2")
        rows = visit.page.locator(".fact:visible .text").all_text_contents()
        self.assertEqual(
            sorted(rows), ["travel time of bathroom, kitchen", "travel time of kitchen, bathroom"]
        )
        visit.page.keyboard.press("Escape")
        visit.page.keyboard.press(visit.page.get_attribute("nav a[href='#machines']", "data-key"))
        self.assertEqual(visit.page.evaluate("document.activeElement.id"), "machines")
        # None runs, so all are folded.
        visit.page.locator(".machine .name", has_text="NAVIGATE").click()
        visit.wait_text(".node.state", "DRIVE")
        node = visit.page.locator(".node.state", has_text="DRIVE")
        node.focus()
        visit.page.keyboard.press("Enter")
        visit.wait_text("#userdata .title", "Userdata of /NAVIGATE")
        visit.wait_text("#userdata .ran li", "DRIVE →")
        overflow = visit.page.evaluate("document.documentElement.scrollWidth > window.innerWidth")
        self.assertFalse(overflow, "a phone would have to be scrolled sideways")

    def test_3_hostile_names_are_shown_as_text(self):
        visit = self.visit()
        visit.wait_text("#knowledge-list", "travel time")
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
        self.assertEqual(visit.page.locator("main img:not(#said-picture), main script").count(), 0)
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
            "() => (document.querySelector('#map image').getAttribute('href') || '').startsWith('map.png')"
        )
        visit.wait_text(".map-point text", "kitchen")
        self.assertEqual(visit.page.evaluate("async () => (await fetch('/map.png')).status"), 200)
        maps.unregister()
        people.unregister()

    def test_5_pages_of_two_windows_see_a_change(self):
        first = self.visit()
        visits = [first, self.visit(beside=first), self.operator()]
        self.knowledge.add_facts("(checked kitchen)")
        for visit in visits:
            visit.wait_text("#knowledge-list .fact", "kitchen checked")
        self.knowledge.remove_facts("(checked kitchen)")
        for visit in visits:
            visit.wait(
                "() => ![...document.querySelectorAll('.fact')]"
                ".some((row) => !row.hidden && row.textContent.includes('kitchen checked'))"
            )

    def test_8_the_page_comes_back_when_the_node_does_and_keeps_the_history(self):
        visit = self.visit(color_scheme="dark")
        visit.wait_text("#connection", "live")
        # More events than the page is given at once.
        parts = [
            DiagnosticStatus(name=f"part {number}", level=DiagnosticStatus.WARN) for number in range(250)
        ]
        diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, latch=True, queue_size=1)
        diagnostics.publish(DiagnosticArray(status=parts))
        visit.wait_text("#history-list .said", "part 249")  # its warning, or later its silence
        diagnostics.unregister()
        self.knowledge.add_facts("(checked bathroom)")
        visit.choose_kinds("knowledge")
        visit.wait_text("#history-list .said", "bathroom checked added")
        self.leave()
        self.monitor.stop()
        visit.wait_text("#connection", "no news since")
        self.monitor.start()
        visit.wait_text("#connection", "live")
        visit.wait_text("#knowledge-list .fact", "bathroom checked")
        self.knowledge.add_facts("(checked kitchen)")
        visit.wait_text("#knowledge-list .fact", "kitchen checked")

        # A new page sees what was before it, back to the first event.
        visit = self.visit()
        events = visit.page.evaluate("async () => (await fetch('/history.json')).json()")
        self.assertGreater(len(events), 250)
        visit.choose_kinds("mission", "goal", "action")
        wanted = [event["text"] for event in events if event["kind"] in ("mission", "goal", "action")][::-1]
        # Scrolling to the end of the list is what makes it longer.
        visit.wait(
            "(count) => { const list = document.getElementById('history-list'); list.scrollTop = 1e6;"
            " return list.querySelectorAll('.said').length >= count; }",
            len(wanted),
        )
        self.assertEqual(visit.texts("#history-list .said"), wanted)
        self.assertEqual(visit.page.locator("#history-list .run").count(), 0, "one master, one run")
        self.assertTrue(any(text.startswith("“kitchen checked”: succeeded") for text in wanted))

        # Started without operators, it only shows.
        visit.wait(
            "() => document.getElementById('control').hidden && document.getElementById('stop').hidden"
        )
        answer = visit.page.evaluate(
            "async () => { const answer = await fetch('/control/pause', {method: 'POST'});"
            " return [answer.status, await answer.text()]; }"
        )
        self.assertEqual(answer[0], 403)
        self.assertIn("read-only", answer[1])

    def test_9_an_application_adds_the_panel_of_the_readme(self):
        visit = self.visit()
        battery = rospy.Publisher("battery", BatteryState, latch=True, queue_size=1)
        self.addCleanup(battery.unregister)
        battery.publish(BatteryState(percentage=0.75))
        visit.wait_text("#battery p", "75 %")
        self.assertIn("Battery", visit.texts("nav a"))
        battery.publish(BatteryState(percentage=0.5))
        visit.wait_text("#battery p", "50 %")
        visit.wait_text("#tables", "No tables are known.")
        # A launch file that is started later names a panel in a parameter: the page draws itself anew.
        for name, value in FLEET.items():
            rospy.set_param(name, value)
            self.addCleanup(rospy.delete_param, name)
        visit.page.wait_for_selector("#fleet p:has-text('etcd cannot be reached')")
        visit.page.wait_for_selector("#battery p:has-text('50 %')")
