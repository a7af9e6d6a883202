# SPDX-License-Identifier: Apache-2.0
"""Requests that join at random moments, with deadlines, cancels, safe points, changes of facts and kills.

CYCLES=1000 makes the long version (make soak). KILLS: share of cycles in which the Executor is killed, 0.05.
"""

import os
import tempfile
from pathlib import Path
from typing import Any, Dict

import rospy
from measuring.ros_process import RosMaster
from stress.joined_stress import JoinedStress
from stress.process_usage import usage_of_nodes

from executive.cancel_cycles import WARM_UP, growth
from executive.floor import Floor

POINTS = 8
DRIVE = 0.3  # s
ACTIONS = "['careful_actions:Navigate', 'careful_actions:Ask']"


def measure() -> Dict[str, Any]:
    """Runs cycles.

    :raises Violation: at the first thing that must not happen.
    """
    cycles, floor = int(os.environ.get("CYCLES", 100)), Floor(POINTS)
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as folder, RosMaster() as master:
        floor.write(Path(folder))
        launch = Path(__file__).with_name("together.launch")
        fails = {"drive_spread": 0.1, "drive_fail": 0.05}
        master.launch(launch, folder=folder, drive_duration=DRIVE, anytime=0, actions=ACTIONS, **fails)
        rospy.init_node("joined_stress", disable_signals=True)
        goals = [f"(checked {point})" for point in floor.points]
        seed, kills = int(os.environ.get("SEED", 1)), float(os.environ.get("KILLS", 0.05))
        stress = JoinedStress(goals, seed, kills=kills)
        stress.run(WARM_UP)
        before = usage_of_nodes()
        stress.run(cycles, lambda number: print(f"{number + 1}/{cycles}", flush=True))
        after = usage_of_nodes()
        rospy.signal_shutdown("done")
    found = {
        "cycles": cycles,
        "requests": sum(stress.outcomes.values()),
        "requests together": stress.together,
        "Executors killed": stress.killed,
        "thread growth": max(growth(before, after, "threads").values()),
        "memory growth mb": round(max(growth(before, after, "memory_mb").values()), 1),
        **stress.outcomes,
    }
    return {"joined_stress": found}
