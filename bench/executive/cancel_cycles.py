# SPDX-License-Identifier: Apache-2.0
"""Random cancels and interruptions on a launched robot, as figures."""

import contextlib
from pathlib import Path
from typing import Any, Callable, ContextManager, Dict, Iterable, Iterator, List, Optional, Tuple

import rospy
from measuring.figures import figure
from measuring.ros_process import RosMaster
from stress.cancel_stress import CancelStress
from stress.process_status import Usage
from stress.process_usage import usage_of_nodes
from stress.stress_cycles import CycleTimes

GOALS = [f"(checked {poi})" for poi in ("kitchen", "bathroom", "dorm_room", "main_door")]
WARM_UP = 10  # cycles until every connection has been made once
TURN = 15  # cycles


def cancel_cycles(launch: Path, cycles: int, longest: float) -> Dict[str, Any]:
    """Runs cycles and returns their latencies, ms, and what the nodes' threads and memory grew by.

    :param longest: s between sending and cancelling at the most.
    """
    with _robot(launch, longest) as stress:
        before = usage_of_nodes()
        times = _run(stress, cycles)
        after = usage_of_nodes()
    results: Dict[str, Any] = {
        **_latencies(times),
        "cancel_cycles": cycles,
        "cancel_thread_growth": max(growth(before, after, "threads").values()),
        "cancel_memory_growth_mb": round(max(growth(before, after, "memory_mb").values()), 1),
    }
    stages = sorted({time.stage for time in times if time.idle is not None})
    results["cancel_to_idle_by_stage_ms"] = {
        stage: _known(time.idle for time in times if time.stage == stage) for stage in stages
    }
    return results


def cancel_cycles_by_turns(
    launch: Path, cycles: int, longest: float, beside: Callable[[], ContextManager[None]]
) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """The latencies, ms, of cycles alone and of as many beside something else, on one robot.

    :param cycles: of each; :data:`TURN` of the one, then as many of the other, and again.
    """
    alone: List[CycleTimes] = []
    together: List[CycleTimes] = []
    with _robot(launch, longest) as stress:
        while len(together) < cycles:
            alone += _run(stress, TURN)
            with beside():
                together += _run(stress, TURN)
    return _latencies(alone), _latencies(together)


@contextlib.contextmanager
def _robot(launch: Path, longest: float) -> Iterator[CancelStress]:
    with RosMaster() as master:
        master.launch(launch)
        rospy.init_node("cancel_cycles", disable_signals=True)
        stress = CancelStress(GOALS, seed=1, longest=longest)
        stress.run(WARM_UP)
        yield stress
        rospy.signal_shutdown("done")


def _run(stress: CancelStress, cycles: int) -> List[CycleTimes]:
    begin = len(stress.times)
    return stress.run(cycles, lambda number: print(f"{number + 1}/{cycles}", flush=True))[begin:]


def _latencies(times: List[CycleTimes]) -> Dict[str, Any]:
    return {
        "cancel_to_stop_ms": _known(time.stop for time in times),
        "cancel_to_idle_ms": _known(time.idle for time in times),
        "preempt_to_urgent_ms": _known(time.urgent for time in times),
        "goal_to_dispatch_ms": _known(time.dispatch for time in times),
    }


def _known(values: Iterable[Optional[float]]) -> Dict[str, float]:
    return figure([value for value in values if value is not None])


def growth(before: Dict[str, Usage], after: Dict[str, Usage], field: str) -> Dict[str, float]:
    """By how much each node grew."""
    return {
        name: getattr(after[name], field) - getattr(before[name], field) for name in before if name in after
    }
