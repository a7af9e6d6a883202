# SPDX-License-Identifier: Apache-2.0
"""Two network namespaces, one for the robot and one for its mind, and the link between them."""

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Callable, Dict, List, Optional

from chaos.judging.events import Event
from chaos.under_test.child import Child

ROBOT, MIND = "robot", "mind"
#: The settings that docs/real-robot.md asks for: a connection that stalled in a cut continues within 2 s
#: after the cut. Without them, TCP waits as long again as the cut has lasted.
TCP_SETTINGS = {"tcp_rto_max_ms": "2000", "tcp_retries2": "255"}
ADDRESSES = {ROBOT: "10.213.7.1", MIND: "10.213.7.2"}


class NetworkError(RuntimeError):
    """Network namespaces cannot be made; the text says why."""


def why_impossible() -> str:
    """Why there can be no namespaces here; empty when there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "there is no ip: apt-get install iproute2"
    if not Path("/dev/net/tun").exists():
        return "there is no /dev/net/tun"
    name = f"tried{os.getpid()}"
    tried = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
    if tried.returncode:  # as to root of a container
        return f"network namespaces are refused: {tried.stderr.strip()}"
    subprocess.run(["ip", "netns", "delete", name], check=False)
    return ""


def why_slow() -> str:
    """Why connections are slow to come back after a cut; empty when they are not."""
    missing = [name for name in TCP_SETTINGS if not Path(f"/proc/sys/net/ipv4/{name}").exists()]
    return f"this kernel has no net.ipv4.{missing[0]} (it takes Linux 6.15)" if missing else ""


class Network:
    """Makes the namespaces and the link.

    :param run: name of the run, part of the namespaces' names.
    :raises NetworkError: when that is not possible.
    """

    def __init__(
        self, run: str, env: Dict[str, str], folder: Path, on_event: Callable[[Event], None]
    ) -> None:
        reason = why_impossible()
        if reason:
            raise NetworkError(reason)
        self.names = {side: f"{run}_{side}" for side in (ROBOT, MIND)}
        self._link: Optional[Child] = None
        try:
            for name in self.names.values():
                subprocess.run(["ip", "netns", "add", name], check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            self.close()
            raise NetworkError(f"ip netns add: {getattr(error, 'stderr', '') or error}") from error
        self._set_tcp()
        ends = [word for side in (ROBOT, MIND) for word in (self.names[side], ADDRESSES[side])]
        script = str(Path(__file__).with_name("link.py"))
        self._link = Child("link", [sys.executable, script, *ends], env, folder, on_event)

    def inside(self, side: str, command: List[str]) -> List[str]:
        """A command line that runs in a namespace."""
        return ["nsenter", f"--net=/run/netns/{self.names[side]}", *command]

    def _set_tcp(self) -> None:
        for side in self.names:
            for name, value in TCP_SETTINGS.items():
                script = f"echo {value} > /proc/sys/net/ipv4/{name}"
                subprocess.run(self.inside(side, ["sh", "-c", script]), capture_output=True, check=False)

    def shape(self, loss: float = 0.0, delay: float = 0.0) -> None:
        """Makes the link lossy and slow; the defaults heal it."""
        if self._link is not None:
            self._link.tell(loss=loss, delay=delay)

    def close(self) -> None:
        """Takes the link and the namespaces away."""
        if self._link is not None:
            self._link.close()
        for name in self.names.values():
            with contextlib.suppress(OSError):
                subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)
