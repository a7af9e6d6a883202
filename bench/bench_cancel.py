"""Latency of cancels and interruptions through the whole robot, simulated at real-time factor 1.

CYCLES=10000 RTF=5 makes the long version (make soak).
"""

import os
from pathlib import Path
from typing import Any, Dict

import rospy
from figures import figure
from ros_process import RosMaster

from merlin_executor.testing.cancel_stress import CancelStress
from merlin_executor.testing.process_usage import Usage, usage_of_nodes

GOALS = [f"(checked {poi})" for poi in ("kitchen", "bathroom", "dorm_room", "main_door")]
WARM_UP = 10


def measure() -> Dict[str, Any]:
    cycles = int(os.environ.get("CYCLES", 200))
    factor = float(os.environ.get("RTF", 1))
    with RosMaster() as master:
        launch = Path(__file__).with_name("apartment.launch")
        master.launch(launch, rtf=factor)
        rospy.init_node("bench_cancel", disable_signals=True)
        stress = CancelStress(GOALS, seed=1)
        stress.run(WARM_UP)
        before = usage_of_nodes()
        times = stress.run(cycles, lambda number: print(f"{number + 1}/{cycles}", flush=True))[WARM_UP:]
        after = usage_of_nodes()
        rospy.signal_shutdown("done")
    results: Dict[str, Any] = {
        "cancel_to_stop_ms": figure([time.stop for time in times if time.stop is not None]),
        "cancel_to_idle_ms": figure([time.idle for time in times if time.idle is not None]),
        "preempt_to_urgent_ms": figure([time.urgent for time in times if time.urgent is not None]),
        "cancel_cycles": cycles,
        "cancel_real_time_factor": factor,
        "cancel_thread_growth": max(growth(before, after, "threads").values()),
        "cancel_memory_growth_mb": round(max(growth(before, after, "memory_mb").values()), 1),
    }
    stages = sorted({time.stage for time in times if time.idle is not None})
    results["cancel_to_idle_by_stage_ms"] = {
        stage: figure([time.idle for time in times if time.idle is not None and time.stage == stage])
        for stage in stages
    }
    return results


def growth(before: Dict[str, Usage], after: Dict[str, Usage], field: str) -> Dict[str, float]:
    return {
        name: getattr(after[name], field) - getattr(before[name], field) for name in before if name in after
    }
