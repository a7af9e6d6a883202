# SPDX-License-Identifier: Apache-2.0
"""Process: the link between two network namespaces, in user space. It can be cut, lossy and slow.

The kernel may have no netem, and a proxy per TCP connection would not know ROS's ports; so each namespace has
a TUN device whose packets pass through this process. A packet that it drops is lost as on a radio link:
neither side is told.

Usage: link.py NAMESPACE ADDRESS NAMESPACE ADDRESS [DEVICE]; commands are lines of JSON:
{"loss": 0..1, "delay": s}. It says `linked` when it is there, and `shaped` after each command.
"""

import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import time
from typing import Dict, List, Tuple

TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
CLONE_NEWNET = 0x40000000
DEVICE = "robotlink"
MTU = 1500


class Shaper:
    """Decides what becomes of a packet; without any device.

    :param seed: of the losses.
    """

    def __init__(self, seed: int = 0) -> None:
        self.loss = 0.0
        self.delay = 0.0
        self._random = random.Random(seed)
        self._queue: List[Tuple[float, int, int, bytes]] = []
        self._number = 0

    def put(self, packet: bytes, target: int, now: float) -> None:
        """Takes a packet for a target.

        :param now: s.
        """
        if self.loss and self._random.random() < self.loss:
            return
        self._number += 1
        heapq.heappush(self._queue, (now + self.delay, self._number, target, packet))

    def due(self, now: float) -> List[Tuple[int, bytes]]:
        """The packets to be delivered now, with their targets. Those under way are lost with a cut."""
        ready = []
        while self._queue and self._queue[0][0] <= now:
            _, _, target, packet = heapq.heappop(self._queue)
            if self.loss < 1.0:
                ready.append((target, packet))
        return ready

    def wait(self, now: float) -> float:
        """s until the next packet is due; a second when there is none."""
        return max(0.0, self._queue[0][0] - now) if self._queue else 1.0


def open_tun(namespace: str, address: str, name: str = DEVICE) -> int:
    """Makes the device in a namespace and returns its descriptor."""
    with open(f"/run/netns/{namespace}") as handle:
        if ctypes.CDLL(None, use_errno=True).setns(handle.fileno(), CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"cannot enter the network namespace {namespace}")
    device = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TUN | IFF_NO_PI))
    for words in (
        ["addr", "add", f"{address}/24", "dev", name],
        ["link", "set", name, "mtu", str(MTU), "up"],
        ["link", "set", "lo", "up"],
    ):
        subprocess.run(["ip", *words], check=True)
    return device


def main() -> int:
    """Forwards until the input is closed; returns the exit code."""
    name = sys.argv[5] if len(sys.argv) > 5 else DEVICE
    one = open_tun(sys.argv[1], sys.argv[2], name)
    other = open_tun(sys.argv[3], sys.argv[4], name)
    target: Dict[int, int] = {one: other, other: one}
    shaper = Shaper()
    print(json.dumps({"at": time.monotonic(), "kind": "linked"}), flush=True)
    control = sys.stdin.fileno()
    while True:
        ready, _, _ = select.select([one, other, control], [], [], shaper.wait(time.monotonic()))
        for source in ready:
            if source == control:
                line = os.read(control, 4096)
                if not line:
                    return 0
                for part in line.decode().splitlines():
                    setting = json.loads(part)
                    shaper.loss, shaper.delay = setting["loss"], setting["delay"]
                    print(json.dumps({"at": time.monotonic(), "kind": "shaped"}), flush=True)
            else:
                shaper.put(os.read(source, 65536), target[source], time.monotonic())
        for device, packet in shaper.due(time.monotonic()):
            os.write(device, packet)


if __name__ == "__main__":
    sys.exit(main())
