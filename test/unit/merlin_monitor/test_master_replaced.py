"""A monitor whose master is replaced shows the new run only, at the same address, and so do pages that are open."""

import json
import urllib.request
from typing import Any, Dict

from shown_page import Visit, chromium

# Publishes what an Executor and a mission publish; its argument is the name of the mission.
RUN = """
import sys, rospy
from merlin_msgs.msg import MissionStatus
rospy.init_node("mission")
publisher = rospy.Publisher("merlin/mission", MissionStatus, latch=True, queue_size=1)
publisher.publish(MissionStatus(mission=sys.argv[1], state=MissionStatus.RUNNING))
print("published", flush=True)
rospy.spin()
"""


def state(address: str) -> Dict[str, Any]:
    with urllib.request.urlopen(f"{address}state.json", timeout=10) as answer:
        return json.load(answer)["state"]


def test_nothing_of_the_old_run_is_left(master: Any) -> None:
    master.api.setParam("/test", "/monitor/port", 0)
    monitor = master.spawn("rosrun", "merlin_monitor", "monitor", "__name:=monitor", "_history:=")
    address = monitor.expect("monitor: http").split(" ", 1)[1]
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
