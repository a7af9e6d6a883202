# SPDX-License-Identifier: Apache-2.0
"""What pages that are open cost the monitor: its share of a core with none, one and 200 of them.

The home's mission runs meanwhile. The clients are programs that read the live feed, in their own process.
"""

import asyncio
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Dict, List

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import aiohttp
import rospy
from measuring.process_tree import descendants, name, processor
from measuring.ros_process import RosMaster
from merlin_msgs.msg import MissionStatus
from processes.bench_memory import LAUNCH, LIMIT

ADDRESS = "/merlin_monitor/address"
CLIENTS = (0, 1, 200)
WARM_UP = 5.0  # s
DURATION = 20.0  # s


async def read(address: str, clients: int) -> None:
    """Reads the live feed with many clients; prints after DURATION how many messages each one got."""
    counts = [0] * clients

    async def one(session: aiohttp.ClientSession, number: int) -> None:
        async with session.ws_connect(f"{address}live", max_msg_size=0) as socket:
            async for _ in socket:
                counts[number] += 1

    connector = aiohttp.TCPConnector(limit=0)
    async with aiohttp.ClientSession(connector=connector) as session:
        tasks = [asyncio.ensure_future(one(session, number)) for number in range(clients)]
        await asyncio.sleep(WARM_UP)
        print("open", flush=True)
        before = list(counts)
        await asyncio.sleep(DURATION)
        got = [after - earlier for after, earlier in zip(counts, before)]
        print(min(got, default=0), len([task for task in tasks if not task.done()]), flush=True)
        for task in tasks:
            task.cancel()


def share(monitor: int, address: str, clients: int) -> List[float]:
    """% of a core that the monitor uses, and messages per second that the slowest client gets.

    :raises RuntimeError: a client lost its connection.
    """
    command = [sys.executable, __file__, address, str(clients)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        used, begin = sum(processor([monitor]).values()), time.monotonic()
        words = process.stdout.readline().split()
        wall = time.monotonic() - begin
        used = sum(processor([monitor]).values()) - used
    if not words or int(words[1]) != clients:
        raise RuntimeError(f"of {clients} clients these stayed: {words[1:]}")
    return [100.0 * used / wall, int(words[0]) / wall]


def measure() -> Dict[str, Any]:
    """Keys: monitor_clients_*."""
    results: Dict[str, Any] = {"monitor_clients_percent_of_a_core": {}, "monitor_clients_messages_per_s": {}}
    with RosMaster() as master:
        folder = Path(master._folder.name)
        launched = master.launch(LAUNCH, results=folder / "results", rtf=1, monitor_port=0)
        rospy.init_node("bench_monitor_clients", disable_signals=True)
        # On a busy machine the mission may begin before the page is there.
        while rospy.wait_for_message("/merlin/mission", MissionStatus, LIMIT).task < 1 or not rospy.has_param(
            ADDRESS
        ):
            time.sleep(0.5)
        (monitor,) = [pid for pid in descendants(launched.pid) if name(pid) == "monitor"]
        address = rospy.get_param(ADDRESS)
        for clients in CLIENTS:
            percent, messages = share(monitor, address, clients)
            results["monitor_clients_percent_of_a_core"][str(clients)] = round(percent, 1)
            results["monitor_clients_messages_per_s"][str(clients)] = round(messages, 1)
    return results


if __name__ == "__main__":
    asyncio.run(read(sys.argv[1], int(sys.argv[2])))
