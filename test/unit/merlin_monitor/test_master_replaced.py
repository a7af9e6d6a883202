"""A monitor whose master is replaced shows the new run only, at the same address."""

import json
import urllib.request
from typing import Any, Dict

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


def shows(address: str, mission: str) -> bool:
    try:
        return state(address)["now"].get("mission", {}).get("name") == mission
    except OSError:
        return False


def wait_until_shown(master: Any, address: str, mission: str) -> None:
    """Waits for the page; the process that looks ends by itself."""
    looker = master.node(
        "import sys, time\n"
        f"sys.path.insert(0, {str(__file__.rsplit('/', 1)[0])!r})\n"
        "from test_master_replaced import shows\n"
        f"while not shows({address!r}, {mission!r}): time.sleep(0.05)\n"
        "print('shown', flush=True)\n"
    )
    looker.expect("shown")


def test_nothing_of_the_old_run_is_left(master: Any) -> None:
    master.api.setParam("/test", "/monitor/port", 0)
    monitor = master.spawn("rosrun", "merlin_monitor", "monitor", "__name:=monitor", "_history:=")
    address = monitor.expect("monitor: http").split(" ", 1)[1]
    first = master.node(RUN, "first")
    wait_until_shown(master, address, "first")
    first.end()
    master.kill()
    master.start()
    again = monitor.expect("monitor: http")
    assert address in again
    master.node(RUN, "second")
    wait_until_shown(master, address, "second")
    texts = json.dumps(state(address))
    assert "first" not in texts
    assert monitor.end() == 0
    assert "Traceback" not in monitor.output
