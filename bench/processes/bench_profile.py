# SPDX-License-Identifier: Apache-2.0
"""What a robot's nodes need while it waits and while it drives: memory, and processor time per minute.

Once over simulated servers, as profile robot has them, and once in the simulator with navigation and speech,
at real-time factor 1; both with the page, which nobody looks at.
"""

import itertools
import multiprocessing
import time
from pathlib import Path
from typing import Any, Callable, Dict, Tuple

import rospy
from measuring.process_tree import descendants, memory, processor
from measuring.ros_process import RosMaster

from merlin_executor.executor_client import MerlinExecutorClient

MINUTE = 60.0  # s
LIMIT = 180.0  # s of wall time for an Executor, and for a goal
PLACES = ("kitchen", "dorm_room", "bathroom", "main_door")
#: Name → launch file below bench, and its arguments.
SYSTEMS: Tuple[Tuple[str, str, Dict[str, Any]], ...] = (
    ("servers", "executive/plain_servers.launch", {"drive_duration": 10.0, "spread": 0.0, "drive_fail": 0.0}),
    ("simulator", "executive/apartment.launch", {}),
)


def used(root: int, wait: Callable[[], None]) -> Dict[str, Any]:
    """What a process and all that it has started use meanwhile."""
    before, begin = processor(descendants(root)), time.monotonic()
    wait()
    pids, minutes = descendants(root), (time.monotonic() - begin) / MINUTE
    seconds = {key: (value - before.get(key, 0.0)) / minutes for key, value in processor(pids).items()}
    return {"memory_mb": _rounded(memory(pids)), "processor_s_per_minute": _rounded(seconds)}


def measured(system: Tuple[str, str, Dict[str, Any]]) -> Dict[str, Any]:
    """The figures of one system.

    :raises RuntimeError: there is no Executor, or a goal fails.
    """
    _, launch, arguments = system
    with RosMaster() as master:
        root = master.launch(
            Path(__file__).resolve().parents[1] / launch, monitor="true", monitor_port=0, **arguments
        ).pid
        rospy.init_node("bench_profile", disable_signals=True)
        client = MerlinExecutorClient()
        if not client.wait_for_executor(LIMIT):
            raise RuntimeError(f"no Executor after {LIMIT:g} s")
        places = itertools.cycle(PLACES)

        def drive(end: float) -> None:
            while time.monotonic() < end:
                result = client.execute(f"(robot_at {next(places)})", LIMIT)
                if result.outcome not in (result.SUCCEEDED, result.ALREADY_TRUE):
                    raise RuntimeError(result.reason)

        drive(time.monotonic() + MINUTE / 4)  # all modules are loaded, all connections made
        waiting = used(root, lambda: time.sleep(MINUTE))
        return {"waiting": waiting, "driving": used(root, lambda: drive(time.monotonic() + MINUTE))}


def _rounded(values: Dict[str, float]) -> Dict[str, float]:
    ordered = sorted(values.items(), key=lambda entry: -entry[1])
    return {"all": round(sum(values.values()), 1), **{key: round(value, 1) for key, value in ordered}}


def measure() -> Dict[str, Any]:
    """Each system from a process of its own: rospy knows one master only."""
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        found = pool.map(measured, SYSTEMS, chunksize=1)
    return {"profile": {name: figures for (name, *_), figures in zip(SYSTEMS, found)}}
