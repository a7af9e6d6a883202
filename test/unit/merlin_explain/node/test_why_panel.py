# SPDX-License-Identifier: Apache-2.0
"""The panel "Why?" of two robots' pages, in Chromium: each asks its own robot; a question is taken back."""

import signal
from pathlib import Path
from typing import Any, Callable, Iterator

import pytest

from merlin_monitor.access.operators import write_operators
from merlin_test import LONG
from merlin_test.chromium import Visit, chromium
from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

TOKEN = "token of the test"

ROBOT = """
import sys, threading, rospy
from merlin_msgs.msg import Claim, Evidence, ExecutorStatus
from merlin_msgs.srv import Explain, ExplainResponse
from merlin_ros.node import run_node
from merlin_ros.ports.service_server import while_wanted

def answer(request):
    print("asked", request.question, request.about, *request.facts, *request.goals, flush=True)
    if request.question == "doing":  # is thought about for long
        gone = threading.Event()
        with while_wanted(gone.set):
            gone.wait(100.0)
        print("given up", flush=True)
    if request.about == "(robot_at kitchen)":
        return ExplainResponse(ok=False, sentence="that is not known")
    evidence = Evidence(kind="fact", text=f"(seen_by {sys.argv[1]})", version=7)
    claim = Claim("link", "It was seen.", [evidence])
    return ExplainResponse(True, f"{sys.argv[1]} says <b>why</b>.", [claim])

def start():
    start.service = rospy.Service("merlin/explain", Explain, answer)
    start.status = rospy.Publisher("merlin/status", ExecutorStatus, queue_size=1, latch=True)
    goals = ["(robot_at kitchen)", "(robot_at hall)"]
    start.status.publish(ExecutorStatus(state=ExecutorStatus.RUNNING, request="/m-1", goals=goals))
    print("started", flush=True)
sys.exit(run_node("robot", start))
"""


@pytest.fixture
def page(master: Any, tmp_path: Path) -> Iterator[Callable[[str], Any]]:
    """Starts a robot with its monitor: its page, and the robot's node."""
    operators = tmp_path / "operators.yaml"
    write_operators(operators, {"Ana": TOKEN})
    with chromium() as browser:

        def start(robot: str) -> Any:
            node = master.node(ROBOT, robot, f"__ns:=/{robot}")
            node.expect("started")
            private = f"/{robot}/merlin_monitor"
            master.api.setParam("/test", f"{private}/port", 0)
            master.api.setParam("/test", f"{private}/operators", str(operators))
            master.api.setParam("/test", f"{private}/history", str(tmp_path / f"{robot}.sqlite"))
            panel = "merlin_explain.node.why_panel:WhyPanel"
            master.api.setParam("/test", f"/{robot}/merlin/panels/why", panel)
            monitor = master.spawn(
                node_path("merlin_monitor", "monitor"), "__name:=merlin_monitor", f"__ns:=/{robot}"
            )
            visit = Visit(browser, monitor.expect("monitor: http").split(" ", 1)[1])
            visit.page.click("#operator")
            visit.page.fill("#token", TOKEN)
            visit.page.keyboard.press("Enter")
            visit.wait_text("#operator", "Ana")
            return visit, node

        yield start


def test_each_page_asks_its_own_robot_and_takes_a_question_back(page: Callable[[str], Any]) -> None:
    (ann, anns), (bob, bobs) = page("ann"), page("bob")
    ann.page.click("#why button:has-text('last thing fail')")
    ann.wait_text("#why .sentence", "ann says <b>why</b>.")
    assert anns.expect("asked") == "asked failed "
    shown = ann.page.locator("#why details")
    assert shown.get_attribute("open") is None  # the evidence is folded
    assert "It was seen." in (shown.text_content() or "")
    assert "fact: (seen_by ann) (version 7)" in (shown.text_content() or "")
    assert bob.texts("#why .sentence") == []

    bob.page.click("#why button:has-text('What are you doing')")
    bobs.expect("asked doing")
    bob.wait_text("#why .why-asked", "Ana asks: What are you doing")
    ann.page.fill("#why-facts", "(open door)")
    ann.page.fill("#why-goals", "(robot_at hall)")
    ann.page.click("#what-if button")
    assert anns.expect("asked what_if") == "asked what_if  (open door) (robot_at hall)"
    ann.wait_text("#why .title", "What if (open door) for (robot_at hall)?")
    bob.page.click("#why button:has-text('last thing fail')")  # while the first one is answered
    bob.wait_text("#control-said[data-bad]", "Another question is being answered")
    bob.page.click("#why .why-cancel")
    bobs.expect("given up")
    bob.wait_text("#why .sentence", "Not answered: taken back")
    bob.page.click("#why button:has-text('Why (robot_at kitchen)')")
    bob.wait_text("#why .sentence", "Not answered: that is not known")
    bob.page.click("#why button:has-text('Why (robot_at hall)')")  # one button for each goal
    assert bobs.expect("asked why") == "asked why (robot_at kitchen)"
    assert bobs.expect("asked why") == "asked why (robot_at hall)"
    for visit in (ann, bob):
        assert visit.complaints == []
    bob.close()

    # A text that no message can have is not answered; the next question is.
    ann.page.fill("#why-goals", "")
    ann.page.evaluate("document.getElementById('why-facts').value = '(open \\ud800)'")
    ann.page.click("#what-if button")
    ann.wait_text("#why .sentence", "Not answered:")
    ann.page.click("#why button:has-text('last thing fail')")
    assert anns.expect("asked") == "asked failed "
    ann.wait_text("#why .sentence", "ann says")
    ann.close()


def test_ctrl_c_of_the_command_ends_the_work_in_the_node(master: Any) -> None:
    robot = master.node(ROBOT, "ann", "__name:=merlin_executor")
    robot.expect("started")
    command = master.spawn(node_path("merlin", "why"), "--doing")
    robot.expect("asked doing")
    command.send(signal.SIGINT)
    robot.expect("given up")
    assert command.process.wait(LONG) == 130
