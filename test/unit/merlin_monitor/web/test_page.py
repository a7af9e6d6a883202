# SPDX-License-Identifier: Apache-2.0
"""The page in Chromium: at a glance, by keyboard, on every size, and without barriers."""

from typing import Any, List

import pytest
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from merlin_msgs.msg import (
    ExecutorStatus,
    GoalQueue,
    GuardStatus,
    MachineHolds,
    MissionStatus,
    QueuedGoal,
    StateOutcome,
)
from messages import ended, executor, fact, status, structure
from served import TOKEN, Served
from shown_page import AXE, CHECK, COLOURS, NOW, fill, look_again
from std_msgs.msg import Header

from merlin_monitor.state.knowledge_section import Contents
from merlin_monitor.text.wording import Wording

pytestmark = pytest.mark.processes

CLOCK_SET = 1e9  # s; a clock that has begun near 1970, as that of a robot without a battery for it
SIZES = {"phone": (390, 844), "desktop": (1280, 900), "wide": (2560, 1440)}
SMALL = """() => [...document.querySelectorAll("body *")].filter((element) => {
  const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
  if (!own || !element.checkVisibility()) return false;
  const svg = element.closest("svg");
  const box = svg && svg.viewBox.baseVal;
  const scale = box && box.width ? svg.getBoundingClientRect().width / box.width : 1;
  return parseFloat(getComputedStyle(element).fontSize) * scale < 10.95;
}).map((element) => `${element.tagName} ${element.getAttribute("class")}: ${element.textContent}`)"""
OUTSIDE = """() => [...document.querySelectorAll("nav a, header button, #glance > div")]
  .filter((element) => element.checkVisibility())
  .filter((element) => element.getBoundingClientRect().right > innerWidth + 0.5)
  .map((element) => element.textContent)"""
SCROLLS = """() => [...document.querySelectorAll("main *")].filter((element) => element.checkVisibility()
  && !element.closest("svg") && element.clientHeight > 1 && element.scrollHeight > element.clientHeight + 2
  && getComputedStyle(element).overflowY !== "visible").map((element) => element.id || element.className)"""
CUT = """() => [document.documentElement, document.querySelector("nav")]
  .filter((element) => element.scrollWidth > element.clientWidth).length"""


def check(page: Any, what: str, scheme: str) -> None:
    """Nothing bars people from it; between light and dark only the colours differ."""
    if scheme == "light":
        assert page.page.evaluate(CHECK) == [], what
        assert page.page.evaluate(SMALL) == [], what
    else:
        assert page.page.evaluate(CHECK, COLOURS) == [], f"{what}, dark"


def test_no_barriers_on_any_size_in_any_colours(visits: Any) -> None:
    page = visits(color_scheme="light", bypass_csp=True)
    page.wait_text("#health-list .title", "camera")
    page.wait("() => document.querySelectorAll('#plan-graph .node').length > 3")
    page.page.add_script_tag(path=AXE)
    press = page.page.keyboard.press
    for name, (width, height) in SIZES.items():
        page.page.set_viewport_size({"width": width, "height": height})
        for scheme in ("light", "dark"):
            page.page.emulate_media(color_scheme=scheme)
            check(page, name, scheme)
            assert page.page.evaluate(OUTSIDE) == [], name
            assert page.page.evaluate(CUT) == 0, name
        press(",")
        page.page.locator("#past-banner").wait_for()
        for scheme in ("light", "dark"):
            page.page.emulate_media(color_scheme=scheme)
            check(page, f"the past, {name}", scheme)
        press("l")
        page.page.locator("#past-banner").wait_for(state="hidden")
    for scheme in ("light", "dark"):
        page.page.emulate_media(color_scheme=scheme)
        press("?")
        check(page, "the list of keys", scheme)
        press("Escape")
        press("w")
        check(page, "the wall display", scheme)
        press("w")


def test_the_strip_says_state_problem_progress_next_and_end(visits: Any, served: Served) -> None:
    page = visits(bypass_csp=True)
    page.page.add_script_tag(path=AXE)
    page.wait_text("#glance-state", "Working")
    page.wait_text("#glance-problem", "camera: state: camera reports (and 1 more)")
    page.wait_text("#glance-progress", "task 3 of 6, 1 of 6 steps done")
    page.wait_text("#glance-next", "bathroom")
    # The first step ended 2 s late; the second began at 115 s and takes 10 s, and so do the four behind it.
    page.wait_text("#glance-end", "in 45 s (165.0 s)")
    how_long_until_the_mission_is_done(page, served)
    parts = [
        DiagnosticStatus(name=f"{name}: state", level=DiagnosticStatus.OK) for name in ("camera", "battery")
    ]
    served.state.inbox.put(served.state.health.diagnostics, DiagnosticArray(status=parts), 121.0, 1.0)
    look_again(served)
    page.wait_text("#glance-problem", "None")
    stuck = GuardStatus(state=GuardStatus.PASSING, warning="/move_base drives, and the base does not move")
    served.state.inbox.put(served.state.guard.status, stuck, 121.0, 1.0)
    look_again(served)
    page.wait_text("#glance-problem", stuck.warning)
    page.wait_text("#guard-says", stuck.warning)
    tree = served.state.tree
    tree.set("now", "silent", {"since": 118.0, "node": "/merlin_executor", "what": "does not answer"})
    tree.set("map", "silent", {"since": 118.0, "node": "", "what": "is gone"})
    look_again(served)
    page.wait_text("#glance-state", "Not known")
    assert page.page.evaluate(CHECK) == [], "what is not known any more"
    tree.set("now", "silent", None)
    stopped = GuardStatus(state=GuardStatus.STOPPED, reason="stopped by Ana")
    served.state.inbox.put(served.state.guard.status, stopped, 121.0, 1.0)
    look_again(served)
    page.wait_text("#glance-state", "Stopped and held")
    assert page.page.evaluate(CHECK) == [], "stopped and held"


def how_long_until_the_mission_is_done(page: Any, served: Served) -> None:
    assert "mission" not in page.text("#glance-end"), "no task of it was seen from its beginning to its end"
    fourth = MissionStatus(mission="Round", state=1, task=4, tasks=6, description="ask in the bathroom")
    fifth = MissionStatus(mission="Round", state=1, task=5, tasks=6, description="ask in the hall")
    for message, at in ((fourth, 90.0), (fifth, 119.0)):
        served.state.inbox.put(served.state.now.mission, message, at, "/mission")
    # The plan of the fifth ends in 45 s, and the sixth takes 29 s as the fourth did.
    page.wait_text("#glance-end", "in 45 s (165.0 s) · mission in about 74 s")
    # A clock that was set is shown as it is now.
    served.state.tree.set("meta", "simulated", False)
    served.state.tree.set("meta", "clock_set", CLOCK_SET)
    for selector, at, around in (("#clock", NOW, "{}"), ("#glance-end", NOW + 45.0, "in 45 s ({})")):
        clock = page.page.evaluate("(at) => new Date(1000 * at).toLocaleTimeString()", at + CLOCK_SET)
        page.wait_text(selector, around.format(clock))
    of_ana = executor(ExecutorStatus.RUNNING, request="/page-1-1.0", goals=["(checked hall)"], by="Ana")
    served.state.inbox.put(served.state.now.executor, of_ana, 121.0)
    page.wait_text("#now-because", "asked for by Ana")
    page.wait("() => !/task|Round/.test(document.getElementById('now').innerText)")


def test_an_operator_knows_of_a_problem_sets_facts_plans_and_asks_who_holds(
    visits: Any, served: Served
) -> None:
    page = visits(bypass_csp=True)
    page.page.add_script_tag(path=AXE)
    a_problem_that_is_known_is_so_on_every_page(page, visits(), served)
    page.wait_text("#operator", "Ana")  # signed in on the way
    for shows in (
        what_is_set_by_hand_is_asked_about_and_set_back,
        a_plan_that_is_only_shown_says_in_words_where_it_begins,
        while_a_base_is_held_no_resume_is_offered_and_who_holds_it_is_asked_for,
    ):
        served.robot.calls.clear()
        shows(page, served)


def a_problem_that_is_known_is_so_on_every_page(page: Any, other: Any, served: Served) -> None:
    page.wait_text("#glance-problem", "camera: state: camera reports (and 1 more)")
    page.page.click("#acknowledge")
    page.page.keyboard.type(TOKEN)
    page.page.keyboard.press("Enter")
    page.wait_text("#control-said", "Noted.")
    assert served.robot.calls == [("acknowledge", "part camera: state error", "Ana")]
    for key, said in (
        ("part camera: state error", "battery: state: battery reports (and 1 more)"),
        ("part battery: state warning", "Ana knows: camera: state: camera reports (and 1 more)"),
    ):
        served.state.inbox.put(served.state.acknowledge, key, "Ana", 121.0)
        for each in (page, other):
            each.wait_text("#glance-problem", said)
    page.wait("() => document.getElementById('acknowledge').hidden")


def what_is_set_by_hand_is_asked_about_and_set_back(page: Any, served: Served) -> None:
    page.page.fill("#goal", "(robot_at kitchen)")
    assert not page.page.is_visible("#undo")
    served.robot.running = "asking at the kitchen"
    page.page.click("#set-facts")
    page.wait_text("#confirm-said", "asking at the kitchen runs")
    assert served.robot.calls == []
    page.page.click("#confirm-yes")
    page.wait_text("#control-said", "The knowledge was changed")
    assert served.robot.calls == [("change", "(robot_at kitchen)", "Ana")]
    served.robot.running = ""
    undo = {"facts": "(not (robot_at kitchen))", "words": Wording().fact("(not (robot_at kitchen))")}
    served.state.tree.set("control", "undo", undo)
    page.wait_text("#undo", "Set back: not robot at kitchen")
    with page.page.expect_response("**/control/change"):
        page.page.click("#undo")
    assert served.robot.calls[-1] == ("change", "(not (robot_at kitchen))", "Ana")


def a_plan_that_is_only_shown_says_in_words_where_it_begins(page: Any, served: Served) -> None:
    page.page.fill("#goal", "(checked kitchen)")
    page.page.click("#plan-only")
    page.wait_text("#preview .title", "Not carried out: kitchen checked in 2 steps")
    page.wait_text("#preview .left-out", "Begins when this has ended: driving to the hall")
    assert served.robot.calls == [("plan", "(checked kitchen)", [], "Ana")]


def while_a_base_is_held_no_resume_is_offered_and_who_holds_it_is_asked_for(
    page: Any, served: Served
) -> None:
    served.state.inbox.put(
        served.state.now.executor,
        executor(ExecutorStatus.IDLE, paused=True, waits="the base is held by Bob since 14:03:07"),
        121.0,
    )
    page.wait_text("#pause", "Resume")
    page.wait_text("#queue-list .more", "waits: the base is held by Bob since 14:03:07")
    stopped = GuardStatus(state=GuardStatus.STOPPED, reason="stopped by Bob", since=rospy.Time(14))
    served.state.inbox.put(served.state.guard.status, stopped, 121.0, 1.0)
    page.page.wait_for_selector("#pause", state="hidden")
    served.robot.holder = "the base is held by Bob since 14:03:07"
    page.page.click("#release")
    page.wait_text("#confirm-said", served.robot.holder)
    assert page.page.evaluate(CHECK) == [], "the question"
    page.page.click("#confirm-not")
    page.page.wait_for_selector("#confirm-ask", state="hidden")
    assert served.robot.calls == []
    page.page.click("#release")
    page.page.click("#confirm-yes")
    page.wait_text("#control-said", "may drive again")
    assert served.robot.calls == [("release", "Ana")]
    free = GuardStatus(state=GuardStatus.IDLE)
    served.state.inbox.put(served.state.guard.status, free, 122.0, 2.0)
    page.page.wait_for_selector("#pause:visible")


def test_on_paper_it_is_a_report(visits: Any, served: Served) -> None:
    page = visits(color_scheme="dark", bypass_csp=True)
    rows = "document.querySelectorAll('#knowledge-list [role=listitem]:not([hidden])').length"
    facts = [fact("robot_at", f"place_{number}") for number in range(320)]
    contents = Contents({}, facts, [], [])
    served.state.inbox.put(served.state.knowledge.replace, contents, "/mission", 121.0, True)
    page.wait_text("#knowledge-list", "place 0")
    page.page.add_script_tag(path=AXE)
    page.page.emulate_media(media="print")
    page.page.set_viewport_size({"width": 720, "height": 1018})  # of A4
    # Every list is there as a whole, or says how much is missing; nothing scrolls, nothing can be pressed.
    page.wait(f"() => {rows} === 300")
    more = "getComputedStyle(document.getElementById('knowledge-list'), '::after').content"
    assert page.page.evaluate(more) == '"and 20 more"'
    assert page.page.evaluate(SCROLLS) == []
    assert page.page.evaluate(CUT) == 0
    assert page.page.locator("button:visible").all_text_contents() == [
        "▾ TAKE_ORDER",
        "▸ ASK",
        "▸ NAVIGATE",
    ]
    ink = "({ color, backgroundColor }) => [color, backgroundColor]"
    body = page.page.evaluate(f"({ink})(getComputedStyle(document.body))")
    assert body == ["rgb(0, 0, 0)", "rgb(255, 255, 255)"]
    assert page.page.evaluate(CHECK) == []
    assert page.page.pdf(format="A4").startswith(b"%PDF")
    page.page.emulate_media(media="screen")
    page.wait(f"() => {rows} < 60")


def test_all_panels_show_what_the_robot_has_does_and_did(visits: Any, served: Served) -> None:
    page = visits(bypass_csp=True)
    page.page.add_script_tag(path=AXE)
    for shows in (
        what_is_not_well_and_what_runs_is_unfolded,
        the_queue_is_shown_in_time_as_expected_and_as_it_was,
        the_plan_in_time_and_what_was_said_heard_and_seen,
        of_several_robots_the_page_says_which_are_held,
        a_wide_screen_is_used,
    ):
        shows(page, served)


def what_is_not_well_and_what_runs_is_unfolded(page: Any, served: Served) -> None:
    page.wait_text("#health-list summary", "12 are well")
    shown = page.page.locator("#health-list .title:visible").all_text_contents()
    assert shown == ["camera: state", "battery: state"]
    page.page.click("#health-well > summary")
    assert page.page.locator("#health-list .title:visible").count() == 14

    def unfolded() -> List[str]:
        return page.page.locator(".machine:not(.folded) .name").all_text_contents()

    page.wait("() => document.querySelectorAll('.machine').length === 3")
    assert unfolded() == ["▾ TAKE_ORDER"]
    assert page.texts(".machine .name")[0] == "▾ TAKE_ORDER"
    page.page.locator(".machine .name", has_text="ASK").click()
    page.wait("() => document.querySelectorAll('.machine:not(.folded)').length === 2")
    ended = status("/TAKE_ORDER", info="TERMINATED: succeeded")
    begun = status("/NAVIGATE", "DRIVE", info="STATE TRANSITION")
    for message in (ended, begun):
        served.state.inbox.put(served.state.machines.status, "/host", message, 121.0, 1.0)
    page.wait_text(".machine:not(.folded) .name", "NAVIGATE")
    page.wait("() => document.querySelector('.machine .name').textContent === '▾ NAVIGATE'")
    assert "▾ TAKE_ORDER" not in unfolded()


def the_queue_is_shown_in_time_as_expected_and_as_it_was(page: Any, served: Served) -> None:
    reported, now = served.state.inbox.put, served.state.now
    for request, end in (("/round-1-1.0", 150.0), ("/round-2-1.0", 190.0)):
        running = executor(ExecutorStatus.RUNNING, request=request, goals=["(checked hall)"])
        running.expected_end, running.deadline = map(rospy.Time.from_sec, (end, end + 2.0))
        reported(now.executor, running, end - 30.0)
        if request == "/round-1-1.0":  # idle comes before the answer
            reported(now.executor, executor(ExecutorStatus.IDLE), 155.0)
            reported(now.result, ended(request, "late"), 155.0)
    waits = QueuedGoal(request="/round-3-1.0", goals=["(checked dorm_room)"])
    times = {"expected_begin": 190.0, "expected_end": 220.0, "deadline": 1e9}
    for name, at in times.items():
        setattr(waits, name, rospy.Time.from_sec(at))
    reported(now.queue, GoalQueue(requests=[waits]), 160.0)
    page.wait("() => document.querySelectorAll('#queue-time .planned').length === 3")
    states = "() => [...document.querySelectorAll('#queue-time .real')].map((bar) => bar.dataset.state)"
    assert page.page.evaluate(states) == ["late", "running"]
    assert page.page.evaluate("() => document.querySelectorAll('#queue-time .due').length") == 2
    assert page.page.evaluate("() => document.querySelectorAll('#queue-time .tick').length") < 300
    widths = "(kind) => document.querySelector(`#queue-time .${kind}`).width.baseVal.value"
    assert page.page.evaluate(widths, "real") > page.page.evaluate(widths, "planned"), "it took longer"
    assert page.page.evaluate(CHECK) == []
    assert page.page.evaluate(SMALL) == []


def the_plan_in_time_and_what_was_said_heard_and_seen(page: Any, served: Served) -> None:
    fill(served, 40)
    page.wait("() => document.querySelectorAll('#plan-time .planned').length === 40")
    page.wait("() => document.querySelectorAll('#plan-time .real').length === 2")
    # The one line of a plan without parallel steps is wider than its box, and shows the present.
    box = "document.getElementById('plan-time')"
    assert page.page.evaluate(f"{box}.scrollWidth > 3 * {box}.clientWidth")
    assert len(page.texts("#plan-time text")) > 40
    page.page.focus("#plan-time")
    before = page.page.evaluate(f"{box}.scrollLeft")
    for _ in range(5):
        page.page.keyboard.press("ArrowRight")
    page.wait(f"(before) => {box}.scrollLeft > before", before)
    width = page.page.get_attribute("#plan-time svg", "width")
    page.page.keyboard.press("+")
    assert float(page.page.get_attribute("#plan-time svg", "width")) > float(width)
    long = {**served.state.tree.get("plan", "steps", "39"), "duration": 1e9}  # s
    served.state.inbox.put(lambda: served.state.tree.set("plan", "steps", "39", long))
    page.wait("() => document.querySelector('#plan-time .planned').width.baseVal.value === 2")
    assert page.page.evaluate("() => document.querySelectorAll('#plan-time .tick').length") < 300
    page.page.focus("#plan-graph")
    page.page.keyboard.press("-")
    page.wait_text("#said-list .said", "a coffee please")
    page.wait("() => document.getElementById('said-picture').naturalWidth === 64")
    page.page.click("#map-tools button")
    page.wait("() => document.querySelector('#map-picture svg').viewBox.baseVal.width < 3.9")
    page.page.locator("#map-tools button").nth(2).click()
    page.wait("() => document.querySelector('#map-picture svg').viewBox.baseVal.width === 4")


def of_several_robots_the_page_says_which_are_held(page: Any, served: Served) -> None:
    guard, put = served.state.guard, served.state.inbox.put
    stopped = GuardStatus(state=GuardStatus.STOPPED, reason="stopped by Bob", since=rospy.Time(14))
    put(guard.met, "", False, 1.0)
    for robot in ("ria", "tom"):
        put(guard.met, robot, True, 1.0)
    put(guard.status, stopped, 121.0, 1.0, "ria")
    put(guard.status, GuardStatus(state=GuardStatus.PASSING), 121.0, 1.0, "tom")
    page.wait_text("#guard-says", "Not all robots are held.")
    assert page.texts("#guard-robots li") == [
        "ria: stopped and held by Bob since 14.0 s",
        "tom: not held",
    ]
    look_again(served)
    page.wait_text("#glance-problem", "Not all robots are held.")
    put(guard.status, stopped, 122.0, 1.0, "tom")
    look_again(served)
    page.wait_text("#now-doing", "ria stopped and held by Bob since 14.0 s and tom stopped and held by Bob")
    page.wait_text("#glance-state", "Stopped and held")


def a_wide_screen_is_used(page: Any, served: Served) -> None:
    page.page.set_viewport_size({"width": 2560, "height": 1440})
    width = page.page.evaluate("document.querySelector('main').getBoundingClientRect().width")
    assert width > 2500
    assert (
        page.page.evaluate(
            "() => new Set([...document.querySelectorAll('main > section.card')]"
            ".map((card) => Math.round(card.getBoundingClientRect().left))).size"
        )
        >= 3
    )


def test_keys_and_buttons_do_what_they_say(visits: Any, served: Served) -> None:
    page = visits(bypass_csp=True)
    page.page.add_script_tag(path=AXE)
    keys_do_what_the_list_of_keys_says(page, served)
    served.robot.calls.clear()
    served.state.inbox.put(served.state.machines.holds, MachineHolds(node="/host"), 121.0, 1.0)
    page.wait("() => !document.getElementById('confirm')")
    an_outcome_is_confirmed_or_forced_and_the_level_is_set(page, served)


def keys_do_what_the_list_of_keys_says(page: Any, served: Served) -> None:
    keyboard = page.page.keyboard
    keyboard.press("?")
    page.wait("() => document.getElementById('keys').open")
    keyboard.press("Escape")
    keyboard.press("p")
    page.wait("() => document.getElementById('sign-in').open")
    keyboard.type(TOKEN)
    keyboard.press("Enter")
    page.wait_text("#control-said", "Paused.")
    page.wait("() => document.activeElement.id !== 'token'")
    page.page.wait_for_selector("#goal", state="visible")
    keyboard.press("g")
    assert page.page.evaluate("document.activeElement.id") == "goal"
    keyboard.press("Escape")
    keyboard.press("Shift+S")
    page.wait_text("#control-said", "stopped until")
    keyboard.press("s")  # nothing is held, so that does nothing
    waits = {"confirm": ["GRASP/CLOSE", "GRASP/LIFT"], "confirm_outcomes": ["done", "done"]}
    holds = MachineHolds(node="/host", held=["ASK/SAY"], autonomy="low", **waits)
    served.state.inbox.put(served.state.machines.holds, holds, 121.0, 1.0)
    page.wait("() => document.getElementById('confirm')")
    for key, said in (("s", "Begins."), ("y", "It is left."), ("Shift+X", "Sent."), ("n", "Begins.")):
        page.page.evaluate("document.getElementById('control-said').textContent = ''")
        keyboard.press(key)
        page.wait_text("#control-said", said)
    keyboard.press("a")
    assert page.page.evaluate("document.activeElement.id") == "autonomy"
    keyboard.press("Escape")
    assert [call[:2] for call in served.robot.calls] == [
        ("pause", True),
        ("stop", "Ana"),
        ("go_on", True),
        ("leave", "GRASP/CLOSE"),
        ("cancel_all", "Ana"),
        ("go_on", False),
    ]
    keyboard.press("o")
    page.wait_text("#operator", "Sign in")
    keyboard.press("w")
    page.wait("() => document.body.hasAttribute('data-wall') && location.search.includes('wall')")
    assert not page.page.locator("#knowledge").is_visible()
    keyboard.press("w")
    assert page.page.locator("#knowledge").is_visible()


def an_outcome_is_confirmed_or_forced_and_the_level_is_set(page: Any, served: Served) -> None:
    page.page.set_viewport_size({"width": 390, "height": 844})
    machines = served.state.machines

    def hold(**fields: Any) -> None:
        served.state.inbox.put(machines.holds, MachineHolds(node="/r1/host", **fields), 121.0, 1.0)
        served.state.inbox.put(served.state.now.refresh)

    drawn = structure(
        "/r1_GRASP", ["CLOSE"], [(each, "CLOSE", "None") for each in ("done", "lost")], ["done"]
    )
    served.state.inbox.put(machines.structure, "/r1/grasp", drawn, 0.0)
    served.state.inbox.put(machines.status, "/r1/grasp", status("/r1_GRASP", "CLOSE"), 120.0, 0.0)
    hold(autonomy="low", confirm=["GRASP/CLOSE"], confirm_outcomes=["done"])
    page.wait_text("#now-doing", "done of GRASP/CLOSE waits for an operator")
    page.wait_text("#glance-state", "Held")
    assert page.page.evaluate(CHECK) == []
    assert page.page.evaluate(CUT) == 0
    button = page.page.locator("#robot-control .primary")
    assert button.text_content() == "Confirm done"
    button.focus()
    page.page.keyboard.press("Enter")
    page.page.keyboard.type(TOKEN)
    page.page.keyboard.press("Enter")
    page.wait_text("#control-said", "It is left.")
    # Beside the state, all its outcomes.
    page.page.locator("#machine-list .node", has_text="CLOSE").last.focus()
    page.page.keyboard.press("Enter")
    page.wait("() => document.querySelectorAll('#userdata .leave button').length === 2")
    assert page.texts("#userdata .leave button") == ["Confirm done", "Leave with lost"]
    assert page.page.evaluate(CHECK) == []
    page.page.evaluate("document.getElementById('control-said').textContent = ''")
    page.page.get_by_role("button", name="Leave with lost").click()
    page.wait_text("#control-said", "It is left.")
    assert page.page.input_value("#autonomy") == "low"
    page.page.select_option("#autonomy", "high")
    page.wait_text("#control-said", "It is set.")
    assert page.page.input_value("#autonomy") == "low", "what the robot has not published is not shown"
    assert served.robot.calls == [
        ("leave", "GRASP/CLOSE", "", "/r1/", "Ana"),
        ("leave", "GRASP/CLOSE", "lost", "/r1/", "Ana"),
        ("set_autonomy", "high", "Ana"),
    ]
    hold(autonomy="high")
    page.wait("() => document.getElementById('autonomy').value === 'high'")
    page.wait("() => !document.querySelector('#robot-control .primary')")
    ended = StateOutcome(
        Header(stamp=rospy.Time(121)), "/r1/host", "GRASP/CLOSE", "Ana", "lost", "done", "", []
    )
    served.state.inbox.put(machines.outcome, ended, 121.0)
    over = status("/r1_GRASP", info="TERMINATED: done")
    served.state.inbox.put(machines.status, "/r1/grasp", over, 121.0, 1.0)
    page.wait_text("#userdata .ran", "CLOSE → lost, forced by Ana")
    page.wait("() => document.querySelector('#userdata .leave').hidden")
