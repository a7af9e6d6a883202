# SPDX-License-Identifier: Apache-2.0
"""Memory of a whole `home.launch`, process by process, while its mission runs."""

import time
from pathlib import Path
from typing import Any, Dict

import rospy
from measuring.process_tree import descendants, memory
from measuring.ros_process import RosMaster
from merlin_msgs.msg import MissionStatus

LAUNCH = Path(__file__).resolve().parents[2] / "launch" / "home.launch"
LIMIT = 180.0  # s of wall time until the second task


def measure() -> Dict[str, Any]:
    with RosMaster() as master:
        folder = Path(master._folder.name)
        launched = master.launch(LAUNCH, results=folder / "results", rtf=1, monitor_port=8399)
        rospy.init_node("bench_memory", disable_signals=True)
        end = time.monotonic() + LIMIT
        while time.monotonic() < end:  # the second task: the first has driven and spoken
            if rospy.wait_for_message("/merlin/mission", MissionStatus, LIMIT).task >= 2:
                break
            time.sleep(0.5)
        processes = memory(descendants(launched.pid))
    rounded = {key: round(value, 1) for key, value in sorted(processes.items(), key=lambda entry: -entry[1])}
    return {"home_memory_mb": {**rounded, "all": round(sum(processes.values()), 1)}}
