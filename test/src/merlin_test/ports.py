# SPDX-License-Identifier: Apache-2.0
"""Ports for servers that tests start, several processes of tests at once."""

import contextlib
import random
import socket
from typing import Dict, List, Sequence

RANGE: Sequence[int] = range(20000, 32768)  # below those that the kernel gives to connections

_held: Dict[int, socket.socket] = {}


def free_ports(count: int) -> List[int]:
    """Ports of this machine on which nothing listens; no other process gets them before :func:`release`.

    A server may take its port late, or end and begin again. So each port is held by a datagram socket of
    the same number, which leaves the port itself to the server. The end of this process releases all.
    """
    found: List[int] = []
    while len(found) < count:
        port = random.SystemRandom().choice(RANGE)
        holder = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            holder.bind(("127.0.0.1", port))
            with socket.socket() as tried:
                tried.bind(("", port))
        except OSError:
            holder.close()
            continue
        _held[port] = holder
        found.append(port)
    return found


def release(ports: Sequence[int]) -> None:
    """Others may use these ports again."""
    for port in ports:
        with contextlib.suppress(KeyError):
            _held.pop(port).close()
