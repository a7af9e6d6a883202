# SPDX-License-Identifier: Apache-2.0
"""What a fleet on one machine needs before its robots start."""

import os
import threading
import time
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple, Type

from chaos.under_test.network import NetworkError
from measuring.tables import end_as_by_ctrl_c

from fleet.network import FleetNetwork
from merlin_fleet.certificates import Folder
from merlin_fleet.commands.keys_command import main as keys
from merlin_fleet.fleet_client import FleetError

FLEET = "demo"
EXIT_START, EXIT_INTERRUPTED = 3, 130


class Say:
    """Prints with the time since the beginning, one line at a time."""

    def __init__(self) -> None:
        self._begun = time.monotonic()
        self._lock = threading.Lock()

    def __call__(self, text: str) -> None:
        with self._lock:
            print(f"{time.monotonic() - self._begun:6.1f} s  {text}", flush=True)


def play(run: Callable[[Say], int], mistakes: Tuple[Type[BaseException], ...]) -> int:
    """Runs something that a signal may end; returns the exit code.

    :param run: takes what prints its lines, returns its exit code.
    :param mistakes: exceptions that say why it cannot run.
    """
    end_as_by_ctrl_c()
    say = Say()
    try:
        return run(say)
    except mistakes as error:
        say(f"it does not work: {error}")
        return EXIT_START
    except KeyboardInterrupt:
        say("interrupted")
        return EXIT_INTERRUPTED


def make_network(names: List[str], folder: Path, say: Say) -> Optional[FleetNetwork]:
    """The namespaces; None: they are not possible here, and that was said."""
    try:
        return FleetNetwork(f"fleet{os.getpid()}", names, dict(os.environ), folder)
    except NetworkError as error:
        say(f"NO LINK IS CUT: all robots share this machine's network, without certificates ({error})")
        return None


def make_keys(network: FleetNetwork, names: List[str], folder: Path) -> Path:
    """Certificates of the hub, as it is reached over the links, and of the robots; returns their folder."""
    hosts = ["127.0.0.1", *map(network.hub_address, names)]
    given = [word for host in hosts for word in ("--host", host)]
    given += [word for name in names for word in ("--robot", name)]
    if keys(["make", str(folder / "keys"), "--client", "desk", *given]):
        raise FleetError("there are no certificates")
    return folder / "keys"


def allow_robots(path: Path, endpoint: str) -> None:
    """Lets the hub give each robot its own rights.

    :param path: of the certificates.
    """
    if keys(["allow", str(path), "--hub", endpoint, "--fleet", FLEET]):
        raise FleetError("the hub gives no rights")


def launch_arguments(
    name: str, network: Optional[FleetNetwork], ports: Sequence[int], folder: Path
) -> List[str]:
    """Arguments of a robot's launch file.

    :param ports: of the hub's members.
    """
    host = "127.0.0.1" if network is None else network.hub_address(name)
    hub = ",".join(f"{host}:{port}" for port in ports)
    given = [f"robot:={name}", f"hub:={hub}", f"fleet:={FLEET}", f"outbox:={folder}/{name}.sqlite"]
    if network is not None:
        tls = Folder(folder / "keys").tls(f"robot.{name}")
        given += [f"ca:={tls.ca}", f"certificate:={tls.certificate}", f"key:={tls.key}"]
    return given
