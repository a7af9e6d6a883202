"""The link between two network namespaces: packets pass, are lost while it is cut, and pass again."""

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Iterator, List

import pytest
from chaos.events import Event
from chaos.network import ADDRESSES, MIND, ROBOT, Network, why_impossible

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
client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
client.settimeout(float(sys.argv[2]))
client.sendto(b'hello', (sys.argv[1], 5005))
try:
    print(client.recv(100).decode())
except socket.timeout:
    print('nothing')
"""


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    linked = threading.Event()

    def receive(event: Event) -> None:
        if event.kind == "linked":
            linked.set()

    made = Network(f"test{os.getpid()}", dict(os.environ), tmp_path, receive)
    try:
        assert linked.wait(30.0), (tmp_path / "link.err").read_text()
        yield made
    finally:
        made.close()


def run(network: Network, side: str, code: str, *words: str) -> List[str]:
    return network.inside(side, [sys.executable, "-c", code, *words])


def ask(network: Network, limit: float) -> str:
    command = run(network, MIND, ASK, ADDRESSES[ROBOT], str(limit))
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout.strip()


def test_a_link_can_be_cut_and_healed(network: Network) -> None:
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


def test_namespaces_are_taken_away(network: Network) -> None:
    network.close()
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert not [name for name in network.names.values() if name in left]
