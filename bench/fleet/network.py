# SPDX-License-Identifier: Apache-2.0
"""A network namespace for the hub and one for each robot, and the links between them."""

import contextlib
import ctypes
import subprocess
import sys
import threading
from pathlib import Path
from typing import Dict, List, Sequence

from chaos.judging.events import Event
from chaos.under_test.child import Child
from chaos.under_test.link import CLONE_NEWNET
from chaos.under_test.network import NetworkError, why_impossible

LINK = Path(__file__).resolve().parents[1] / "chaos" / "under_test" / "link.py"
LIMIT = 60.0  # s for a link to be there


class FleetNetwork:
    """Makes namespaces and links, and puts this process into the hub's namespace: call it before any thread.

    :param run: part of the namespaces' names.
    :param robots: names.
    :raises NetworkError: when that is not possible.
    """

    def __init__(self, run: str, robots: Sequence[str], env: Dict[str, str], folder: Path) -> None:
        reason = why_impossible()
        if reason:
            raise NetworkError(reason)
        self._hub = f"{run}_hub"
        self._spaces = {robot: f"{run}_{robot}" for robot in robots}
        self._links: Dict[str, Child] = {}
        self._linked = {robot: threading.Event() for robot in robots}
        try:
            for name in (self._hub, *self._spaces.values()):
                self._ip("add", name)
            _enter(self._hub)
            for robot in robots:
                self._link(robot, env, folder)
        except BaseException:
            self.close()
            raise

    def hub_address(self, robot: str) -> str:
        """The hub's address, as a robot reaches it."""
        return f"10.214.{1 + list(self._spaces).index(robot)}.1"

    def inside(self, robot: str, command: List[str]) -> List[str]:
        """A command line that runs in a robot's namespace."""
        return ["nsenter", f"--net=/run/netns/{self._spaces[robot]}", *command]

    def shape(self, robot: str, loss: float = 0.0, delay: float = 0.0) -> None:
        """Makes a robot's link lossy and slow; a loss of 1 cuts it, the defaults mend it."""
        self._links[robot].tell(loss=loss, delay=delay)

    def close(self) -> None:
        """Takes links and namespaces away."""
        for link in self._links.values():
            link.close()
        for name in (self._hub, *self._spaces.values()):
            with contextlib.suppress(NetworkError):
                self._ip("del", name)

    def _link(self, robot: str, env: Dict[str, str], folder: Path) -> None:
        hub = self.hub_address(robot)
        ends = [self._hub, hub, self._spaces[robot], hub[:-1] + "2", f"link{hub.split('.')[2]}"]

        def receive(event: Event) -> None:
            if event.kind == "linked":
                self._linked[robot].set()

        self._links[robot] = Child(f"link_{robot}", [sys.executable, str(LINK), *ends], env, folder, receive)
        if not self._linked[robot].wait(LIMIT):
            raise NetworkError(f"no link for {robot}: {(folder / f'link_{robot}.err').read_text()}")

    @staticmethod
    def _ip(what: str, name: str) -> None:
        try:
            subprocess.run(["ip", "netns", what, name], check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            raise NetworkError(f"ip netns {what}: {getattr(error, 'stderr', '') or error}") from error


def _enter(namespace: str) -> None:
    with open(f"/run/netns/{namespace}") as handle:
        if ctypes.CDLL(None, use_errno=True).setns(handle.fileno(), CLONE_NEWNET):
            raise NetworkError(f"the namespace {namespace} cannot be entered: {ctypes.get_errno()}")
