# SPDX-License-Identifier: Apache-2.0
"""What a robot without a goal costs, node by node, and how long all its nodes take to end."""

import signal
import time
from pathlib import Path
from typing import Any, Dict

import rospy
from measuring.process_tree import descendants, processor
from measuring.ros_process import RosMaster

from merlin_executor.executor_client import MerlinExecutorClient

LAUNCH = Path(__file__).resolve().parents[2] / "launch" / "include" / "application.launch"
LIMIT = 180.0  # s of wall time until the Executor serves
SETTLED = 10.0  # s of wall time until what begins has begun
MEASURED = 30.0  # s of wall time


def measure() -> Dict[str, Any]:
    with RosMaster() as master:
        launched = master.launch(LAUNCH, on="servers")
        rospy.init_node("bench_idle", disable_signals=True)
        if not MerlinExecutorClient().wait_for_executor(LIMIT):
            raise RuntimeError(f"no Executor within {LIMIT:g} s")
        time.sleep(SETTLED)
        nodes = descendants(launched.pid)
        before, begun = processor(nodes), time.monotonic()
        time.sleep(MEASURED)
        after, passed = processor(nodes), time.monotonic() - begun
        begun = time.monotonic()
        launched.send_signal(signal.SIGINT)
        launched.wait(LIMIT)
        ended = time.monotonic() - begun
    spent = {key: 1000.0 * (after[key] - before[key]) / passed for key in before if key in after}
    rounded = {key: round(value, 1) for key, value in sorted(spent.items()) if value >= 0.1}
    return {
        "idle_ms_per_s": {**rounded, "all": round(sum(spent.values()), 1)},
        "all_nodes_end_s": round(ended, 2),
    }
