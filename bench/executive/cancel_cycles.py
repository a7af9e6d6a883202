# SPDX-License-Identifier: Apache-2.0
"""Random cancels and interruptions on a launched robot, as figures."""

import contextlib
from pathlib import Path
from typing import Any, Callable, ContextManager, Dict, List, Optional

import rospy
from measuring.figures import figure
from measuring.ros_process import RosMaster
from stress.cancel_stress import CancelStress
from stress.process_status import Usage
from stress.process_usage import usage_of_nodes

GOALS = [f"(checked {poi})" for poi in ("kitchen", "bathroom", "dorm_room", "main_door")]
WARM_UP = 10  # cycles until every connection has been made once


def cancel_cycles(
    launch: Path,
    cycles: int,
    longest: float,
    beside: Callable[[], ContextManager[None]] = contextlib.nullcontext,
) -> Dict[str, Any]:
    """Runs cycles and returns their latencies, ms, and what the nodes' threads and memory grew by.

    :param longest: s between sending and cancelling at the most.
    :param beside: what else is done meanwhile.
    """
    with RosMaster() as master:
        master.launch(launch)
        rospy.init_node("cancel_cycles", disable_signals=True)
        stress = CancelStress(GOALS, seed=1, longest=longest)
        stress.run(WARM_UP)
        before = usage_of_nodes()
        with beside():
            times = stress.run(cycles, lambda number: print(f"{number + 1}/{cycles}", flush=True))[WARM_UP:]
        after = usage_of_nodes()
        rospy.signal_shutdown("done")

    def known(values: List[Optional[float]]) -> Dict[str, float]:
        return figure([value for value in values if value is not None])

    results: Dict[str, Any] = {
        "cancel_to_stop_ms": known([time.stop for time in times]),
        "cancel_to_idle_ms": known([time.idle for time in times]),
        "preempt_to_urgent_ms": known([time.urgent for time in times]),
        "goal_to_dispatch_ms": known([time.dispatch for time in times]),
        "cancel_cycles": cycles,
        "cancel_thread_growth": max(growth(before, after, "threads").values()),
        "cancel_memory_growth_mb": round(max(growth(before, after, "memory_mb").values()), 1),
    }
    stages = sorted({time.stage for time in times if time.idle is not None})
    results["cancel_to_idle_by_stage_ms"] = {
        stage: known([time.idle for time in times if time.stage == stage]) for stage in stages
    }
    return results


def growth(before: Dict[str, Usage], after: Dict[str, Usage], field: str) -> Dict[str, float]:
    """By how much each node grew."""
    return {
        name: getattr(after[name], field) - getattr(before[name], field) for name in before if name in after
    }
