# SPDX-License-Identifier: Apache-2.0
"""A fleet on one machine: `python bench/fleet --robots 3`. Exit code 0: nothing was lost or done twice."""

import argparse
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fleet.demonstration import Broken, Demonstration, make_folder
from fleet.ledger import Ledger
from fleet.network import FleetNetwork
from fleet.robot import Robot
from fleet.setup import FLEET, Say, allow_robots, launch_arguments, make_keys, make_network, play
from merlin_fleet.certificates import Folder
from merlin_fleet.fleet_client import FleetClient, FleetError
from merlin_test.etcd_process import EtcdProcess
from merlin_test.ports import free_ports

RESULTS = Path(__file__).resolve().parents[2] / "results" / "fleet"
NAMES = ("ann", "bob", "cat", "dan", "eve")
PORT = 11311  # of the master, in each robot's own namespace
EXIT_WRONG = 1


def _make_hub(network: Optional[FleetNetwork], names: List[str], folder: Path) -> EtcdProcess:
    """The hub: with certificates and roles where it is reached over links."""
    if network is None:
        return EtcdProcess()
    path = make_keys(network, names, folder)
    etcd = EtcdProcess(certificates=path, listen="0.0.0.0")
    try:
        allow_robots(path, etcd.endpoint)
    except FleetError:
        etcd.close()
        raise
    return etcd


def run(options: argparse.Namespace, say: Say) -> int:
    """Plays the demonstration; returns the exit code."""
    names = list(NAMES[: options.robots])
    folder = make_folder(options.results)
    say(f"logs are in {folder}")
    with ExitStack() as stack:
        network = make_network(names, folder, say)
        if network is not None:
            stack.callback(network.close)
        etcd = _make_hub(network, names, folder)
        stack.callback(etcd.close)
        say(f"the hub is there; {', '.join(names)} start")
        tls = Folder(folder / "keys").tls("client.desk") if network is not None else None
        client = FleetClient(FLEET, [etcd.endpoint], tls)
        stack.callback(client.close)
        robots: Dict[str, Robot] = {}
        demonstration = Demonstration(client, robots, network, Ledger(), say)
        stack.callback(demonstration.close)
        stack.callback(say, "all is ended")
        ports = [PORT] * len(names) if network is not None else free_ports(len(names))
        for name, port in zip(names, ports):
            given = [
                *launch_arguments(name, network, [etcd.port], folder),
                f"drive_duration:={options.drive}",
            ]
            robots[name] = Robot(
                name, given, _inside(network, name), port, folder, _receiver(demonstration, name)
            )
            stack.callback(robots[name].close)
        found = demonstration.play()
    for text in found:
        say(f"WRONG: {text}")
    say("wrong" if found else "nothing was lost, nothing was done twice")
    return EXIT_WRONG if found else 0


def _inside(network: Optional[FleetNetwork], name: str) -> Callable[[List[str]], List[str]]:
    return lambda command: command if network is None else network.inside(name, command)


def _receiver(demonstration: Demonstration, name: str) -> Callable[[Any], None]:
    return lambda event: demonstration.take(name, event)


def main(arguments: List[str]) -> int:
    """Reads the command line, plays, ends everything; returns the exit code."""
    parser = argparse.ArgumentParser(prog="fleet", description=__doc__)
    parser.add_argument("--robots", type=int, default=3, choices=range(2, 1 + len(NAMES)))
    parser.add_argument("--drive", type=float, default=20.0, help="s of a drive (%(default)g)")
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args(arguments)
    return play(lambda say: run(options, say), (Broken, FleetError, OSError, RuntimeError))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
