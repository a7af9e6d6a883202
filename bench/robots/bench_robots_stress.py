# SPDX-License-Identifier: Apache-2.0
"""Random cancels while robots are killed, hang, are taken out and return: does the knowledge stay true?

CYCLES=1000 makes the long version (make soak). What is done follows from SEED; a violation ends it, and
names the cycle.
"""

import os
import tempfile
from pathlib import Path
from typing import Any, Dict

import rospy
from measuring.ros_process import RosMaster
from stress.robots_stress import RobotsStress

from robots.bench_robots_dispatch import PDDL, PLACES, problem

ROBOTS = ["ann", "bob", "carl"]


def measure() -> Dict[str, Any]:
    """Runs the cycles; returns how often what was done, and how it ended."""
    cycles, seed = int(os.environ.get("CYCLES", 50)), int(os.environ.get("SEED", 1))
    with tempfile.TemporaryDirectory(prefix="merlin_bench_") as name, RosMaster() as master:
        folder = Path(name)
        (folder / "problem.pddl").write_text(problem(ROBOTS))
        master.launch(
            Path(__file__).with_name("robot_servers.launch"),
            robots=",".join(ROBOTS),
            domain=PDDL / "domain.pddl",
            problem=folder / "problem.pddl",
            drive=1.0,
        )
        rospy.init_node("bench_robots_stress", anonymous=True, disable_signals=True)
        stress = RobotsStress(ROBOTS, PLACES, seed)
        stress.run(cycles, lambda number: print(f"{number + 1}/{cycles} {dict(stress.done)}", flush=True))
        rospy.signal_shutdown("done")
    return {"robots_stress": {"cycles": cycles, "seed": seed, "robots": len(ROBOTS), **stress.done}}
