# SPDX-License-Identifier: Apache-2.0
"""The link between two network namespaces: packets pass, are lost while it is cut, and pass again."""

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Iterator, List

import pytest
from chaos.judging.events import Event
from chaos.under_test.network import ADDRESSES, MIND, ROBOT, Network, why_impossible

from merlin_test import LONG

pytestmark = pytest.mark.skipif(bool(why_impossible()), reason=why_impossible() or "possible")

ECHO = """
import socket
server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
server.bind(('0.0.0.0', 5005))
print('up', flush=True)
while True:
    data, sender = server.recvfrom(100)
    server.sendto(data, sender)
"""
ASK = """
import socket, sys
from merlin_test import LONG
client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
client.settimeout(float(sys.argv[2]))
client.sendto(b'hello', (sys.argv[1], 5005))
try:
    print(client.recv(100).decode())
except socket.timeout:
    print('nothing')
"""


class Shaped:
    """A network whose link has taken each command before the test goes on."""

    def __init__(self, folder: Path) -> None:
        self._said = {"linked": threading.Event(), "shaped": threading.Event()}
        self.network = Network(f"test{os.getpid()}", dict(os.environ), folder, self._receive)
        assert self._said["linked"].wait(LONG), (folder / "link.err").read_text()

    def _receive(self, event: Event) -> None:
        if event.kind in self._said:
            self._said[event.kind].set()

    def shape(self, **how: float) -> None:
        self._said["shaped"].clear()
        self.network.shape(**how)
        assert self._said["shaped"].wait(LONG)


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Shaped]:
    made = Shaped(tmp_path)
    yield made
    made.network.close()


def run(shaped: Shaped, side: str, code: str, *words: str) -> List[str]:
    return shaped.network.inside(side, [sys.executable, "-c", code, *words])


def ask(shaped: Shaped, limit: float) -> str:
    command = run(shaped, MIND, ASK, ADDRESSES[ROBOT], str(limit))
    return subprocess.run(command, capture_output=True, text=True, timeout=LONG, check=True).stdout.strip()


@pytest.mark.everywhere
def test_a_link_can_be_cut_and_healed(network: Shaped) -> None:
    server = subprocess.Popen(run(network, ROBOT, ECHO), stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        assert server.stdout.readline() == "up\n"
        assert ask(network, 30.0) == "hello"
        network.shape(loss=1.0)
        assert ask(network, 0.5) == "nothing"
        network.shape()
        assert ask(network, 30.0) == "hello"
        network.shape(delay=1.0)
        assert ask(network, 0.5) == "nothing"  # there and back take 2 s
    finally:
        server.kill()
        server.communicate()


def test_namespaces_are_taken_away(network: Shaped) -> None:
    network.network.close()
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert not [name for name in network.network.names.values() if name in left]
