# SPDX-License-Identifier: Apache-2.0
"""Process: starts a launch file's nodes below a master that runs already, as roslaunch does.

What differs from roslaunch: no node ends the others; nodes can be left out, or started at random times. It
ends with its input.
"""

import argparse
import json
import os
import random
import sys
import time
from pathlib import Path
from typing import Dict, List

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import roslaunch
import roslaunch.parent
import roslib
from roslaunch.core import Node, Param

from chaos.faults import NODES
from chaos.under_test.child import Reporter
from chaos.under_test.wall_clock import WallClocks

#: s between SIGINT and SIGTERM, and between that and SIGKILL.
END_LIMITS = (2.0, 1.0)
WORLD, PAGE = "merlin_sim", "merlin_monitor"
#: s within which nodes are started that start at random times.
SPREAD = 10.0


class Launcher(roslaunch.parent.ROSLaunchParent):
    """roslaunch with a changed configuration.

    :param options: of the command line.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__(
            options.run_id,
            [(options.file, options.arguments)],
            show_summary=False,
            sigint_timeout=END_LIMITS[0],
            sigterm_timeout=END_LIMITS[1],
        )
        self._options = options
        self._all: Dict[str, Node] = {}

    def prepare(self) -> List[str]:
        """Reads the launch file and changes it; returns the names of the nodes to start."""
        self._load_config()
        options, config = self._options, self.config
        # roslaunch starts rosout only together with a master of its own.
        config.nodes = [node for node in [*config.nodes, *config.nodes_core] if _chosen(node.name, options)]
        config.nodes_core = []
        for node in config.nodes:
            # Here no node's death ends the run; a required one comes back as under a supervisor.
            # The world is left alone: a new one would have the base elsewhere.
            node.respawn = (node.respawn or node.required) and node.name != WORLD
            node.required = False
            node.output = "log"
            if node.name in options.instead:
                script = Path(__file__).parent / "application" / f"{options.instead[node.name]}.py"
                node.launch_prefix = f"{sys.executable} {script}"
            if options.clocks and node.name in (*NODES, WORLD, PAGE):
                node.env_args += WallClocks(options.clocks).environment(node.name).items()
        if options.without_parameters:
            config.params.clear()
            config.clear_params.clear()
        for key, value in options.set.items():
            config.params[key] = Param(key, value)
        self._all = {node.name: node for node in config.nodes}
        if options.shuffled is not None:
            config.nodes = []  # start_shuffled() starts them
        return sorted(self._all)

    def start_shuffled(self, seed: int) -> Dict[str, float]:
        """Starts the nodes one by one, at times drawn from a seed; returns the times, in s."""
        numbers = random.Random(f"start {seed}")
        times = {name: numbers.uniform(0.0, SPREAD) for name in sorted(self._all)}
        begin = time.monotonic()
        for name in sorted(times, key=lambda name: times[name]):
            time.sleep(max(0.0, begin + times[name] - time.monotonic()))
            self.runner.launch_node(self._all[name])
        return times


def _chosen(name: str, options: argparse.Namespace) -> bool:
    if options.only:
        return name in options.only
    return name not in options.leave_out


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file")
    parser.add_argument("arguments", nargs="*")
    parser.add_argument("--run-id", required=True)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--leave-out", nargs="*", default=[])
    parser.add_argument("--shuffled", type=int)
    parser.add_argument("--without-parameters", action="store_true")
    parser.add_argument("--set", type=json.loads, default={})
    parser.add_argument("--clocks", type=Path, help="folder of the nodes' clocks on the wall")
    parser.add_argument("--instead", type=json.loads, default={})
    return parser.parse_args()


def main() -> int:
    """Starts the nodes, then obeys until the input is closed; returns the exit code."""
    options = _options()
    os.environ["RESPAWN_MOST"] = "1000"  # a campaign kills the same nodes again and again
    # roslaunch prints to standard output, which belongs to our events.
    report = Reporter(os.fdopen(os.dup(1), "w", buffering=1))
    os.dup2(2, 1)
    roslib.set_interactive(True)  # else roslaunch takes the signal handlers for itself
    roslaunch.configure_logging(options.run_id)
    launcher = Launcher(options)
    names = launcher.prepare()
    launcher.start(auto_terminate=False)
    times = launcher.start_shuffled(options.shuffled) if options.shuffled is not None else {}
    report("launched", nodes=names, times=times)
    sys.stdin.read()
    launcher.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
