"""A monitor whose master is replaced shows the new run only, at the same address."""

import asyncio
import json
import urllib.request
from typing import Any, Dict

import aiohttp

LIMIT = 60.0  # s for a mission to be shown

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


def wait_until_shown(address: str, mission: str) -> None:
    """Reads what a page is sent until the mission is in it."""

    async def read() -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(f"{address}live") as socket:
            async for message in socket:
                if f'"{mission}"' in message.data:
                    return
        raise AssertionError(f"the page was closed before it showed {mission}")

    asyncio.run(asyncio.wait_for(read(), LIMIT))


def test_nothing_of_the_old_run_is_left(master: Any) -> None:
    master.api.setParam("/test", "/monitor/port", 0)
    monitor = master.spawn("rosrun", "merlin_monitor", "monitor", "__name:=monitor", "_history:=")
    address = monitor.expect("monitor: http").split(" ", 1)[1]
    first = master.node(RUN, "first")
    wait_until_shown(address, "first")
    first.end()
    master.kill()
    master.start()
    again = monitor.expect("monitor: http")
    assert address in again
    master.node(RUN, "second")
    wait_until_shown(address, "second")
    texts = json.dumps(state(address))
    assert "first" not in texts
    assert monitor.end() == 0
    assert "Traceback" not in monitor.output
