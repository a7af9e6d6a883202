# SPDX-License-Identifier: Apache-2.0
"""Memory of a whole `home.launch`, process by process, while its mission runs."""

import time
from pathlib import Path
from typing import Any, Dict, List

import rospy
from measuring.ros_process import RosMaster
from merlin_msgs.msg import MissionStatus

LAUNCH = Path(__file__).resolve().parents[2] / "launch" / "home.launch"
LIMIT = 180.0  # s of wall time until the second task


def descendants(pid: int) -> List[int]:
    """A process and all it has started."""
    parents: Dict[int, List[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rsplit(")", 1)[1].split()
        except OSError:  # it has ended
            continue
        parents.setdefault(int(fields[1]), []).append(int(path.parent.name))
    found = [pid]
    for known in found:
        found.extend(parents.get(known, ()))
    return found


def memory(pid: int) -> float:
    """MB of a process: its own pages, and its share of those that it has in common with others (PSS)."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1024.0
    return 0.0


def name(pid: int) -> str:
    """The executable of a process, without its interpreter and its folder."""
    words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
    scripts = [word for word in words if word and "python" not in word and not word.startswith("-")]
    return Path(scripts[0]).name if scripts else words[0]


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
        processes: Dict[str, float] = {}
        for pid in descendants(launched.pid):
            try:
                key = name(pid)
                processes[key] = processes.get(key, 0.0) + memory(pid)
            except OSError:  # it has ended
                continue
    rounded = {key: round(value, 1) for key, value in sorted(processes.items(), key=lambda entry: -entry[1])}
    return {"home_memory_mb": {**rounded, "all": round(sum(processes.values()), 1)}}
