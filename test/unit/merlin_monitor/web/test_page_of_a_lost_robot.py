# SPDX-License-Identifier: Apache-2.0
"""What an open page says when the master is replaced, navigation is killed, and a mission hangs."""

import json
import signal
import urllib.request
from typing import Any, Dict, Tuple

import pytest
from shown_page import Visit, chromium

from merlin_test import LONG
from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes

# Publishes what an Executor and a mission publish; its argument is the name of the mission.
RUN = """
import sys, rospy
from merlin_msgs.msg import MissionStatus
from merlin_ros.health import Health, HealthReporter
rospy.init_node("mission")
publisher = rospy.Publisher("merlin/mission", MissionStatus, latch=True, queue_size=1)
publisher.publish(MissionStatus(mission=sys.argv[1], state=MissionStatus.RUNNING, description="a task"))
HealthReporter({"mission": Health}).start()
print("published", flush=True)
rospy.spin()
"""

# Prints a line for each report of the node that is named.
REPORTS = """
import sys, rospy
from diagnostic_msgs.msg import DiagnosticArray
from merlin_test.topic_links import init_node
from merlin_test import LONG
init_node("reports")
def told(message):
    if any(status.name.startswith(sys.argv[1]) for status in message.status):
        print("report", flush=True)
rospy.Subscriber("/diagnostics", DiagnosticArray, told)
rospy.spin()
"""


def state(address: str) -> Dict[str, Any]:
    with urllib.request.urlopen(f"{address}state.json", timeout=LONG) as answer:
        return json.load(answer)["state"]


def start_monitor(master: Any) -> Tuple[Any, str]:
    """The node and the address of its page."""
    master.api.setParam("/test", "/monitor/port", 0)
    monitor = master.spawn(node_path("merlin_monitor", "monitor"), "__name:=monitor", "_history:=")
    return monitor, monitor.expect("monitor: http").split(" ", 1)[1]


def test_nothing_of_the_old_run_is_left(master: Any) -> None:
    monitor, address = start_monitor(master)
    with chromium() as browser:
        visit = Visit(browser, address)
        first = master.node(RUN, "Alphabet")
        visit.wait_text("#now", "Alphabet")
        first.end()
        master.kill()
        master.start()
        again = monitor.expect("monitor: http")
        assert address in again
        master.node(RUN, "Omega")
        visit.wait_text("#now", "Omega")
        visit.wait_text("#connection", "live")
        assert "Alphabet" not in visit.page.inner_text("main")
        assert "Alphabet" not in json.dumps(state(address))
        assert visit.complaints == []
        visit.close()
    assert monitor.end() == 0
    assert "Traceback" not in monitor.output


def test_what_hangs_is_the_headline_and_what_is_killed_the_trouble(master: Any) -> None:
    _, address = start_monitor(master)
    with chromium() as browser:
        visit = Visit(browser, address)
        a_mission_that_hangs_is_the_headline_until_it_goes_on(master, visit)
        navigation_that_is_killed_is_the_trouble(master, visit)
        assert visit.complaints == []
        visit.close()


def a_mission_that_hangs_is_the_headline_until_it_goes_on(master: Any, visit: Visit) -> None:
    mission = master.node(RUN, "Alphabet")
    visit.wait_text("#now-chain", "Alphabet")
    visit.wait_text("#health-list .title", "mission: ")  # its first report, or its second
    mission.send(signal.SIGSTOP)
    visit.wait_text("#now-doing", "not known: Alphabet does not answer")
    visit.wait_text("#now-because", "before: a task")
    mission.send(signal.SIGCONT)
    visit.wait_text("#now-doing", "idle")
    assert visit.page.title() == "idle – MERLIN"


def navigation_that_is_killed_is_the_trouble(master: Any, visit: Visit) -> None:
    navigation = master.spawn(node_path("merlin_reactive", "navigation"), "__name:=navigation")
    visit.wait_text("#health-list .title", "navigation: ")
    reports = master.node(REPORTS, "navigation: ")
    for _ in range(5):  # what reports only now and then is not missed at once
        reports.expect("report")
    assert visit.page.locator("#now-trouble").is_hidden()
    navigation.end(signal.SIGKILL)
    visit.wait_text("#now-trouble", "the navigation server (navigation) is gone")
    visit.wait_text("#glance-problem", "the navigation server (navigation) is gone")
