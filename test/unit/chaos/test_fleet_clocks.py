# SPDX-License-Identifier: Apache-2.0
"""Clocks that the campaign of a fleet gives to its robots: all that reads one or waits sees the same time."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Dict

import pytest
from fleet.clocks import Clock, Clocks

pytestmark = pytest.mark.processes

AHEAD, SLOW = 3600.0, 0.8
TICK = 0.02  # s; /proc/uptime, which no clock of a process changes, has hundredths

CHILD = """
import json, queue, socket, threading, time
import grpc

def uptime():
    return float(open("/proc/uptime").read().split()[0])

def by_grpc():
    deaf = socket.socket()
    deaf.bind(("127.0.0.1", 0))
    deaf.listen()
    call = grpc.insecure_channel(f"127.0.0.1:{deaf.getsockname()[1]}").unary_unary("/a/b")
    try:
        call(b"", timeout=0.5)
    except grpc.RpcError as error:
        assert error.code() is grpc.StatusCode.DEADLINE_EXCEEDED, error

def by_queue():
    try:
        queue.Queue().get(timeout=0.5)
    except queue.Empty:
        pass

def lasts(wait):
    begun = time.monotonic()
    wait()
    return time.monotonic() - begun

start = uptime(), time.monotonic(), uptime()
waits = {
    "event": lasts(lambda: threading.Event().wait(0.5)),
    "sleep": lasts(lambda: time.sleep(0.5)),
    "queue": lasts(by_queue),
    "gRPC": lasts(by_grpc),
}
end = uptime(), time.monotonic(), uptime()
dates = [time.time(), time.time_ns() / 1e9, time.clock_gettime(time.CLOCK_REALTIME)]
since_boot = time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()
print(json.dumps({"start": start, "end": end, "waits": waits, "dates": dates, "since_boot": since_boot}))
"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Dict[str, Any]:
    """What a process sees whose clock is an hour ahead, and slow."""
    clocks = Clocks({"ann": Clock(AHEAD, SLOW)}, tmp_path_factory.mktemp("clocks"))
    env = {**os.environ, **clocks.environment("ann")}
    before = time.time()
    done = subprocess.run([sys.executable, "-c", CHILD], env=env, capture_output=True, text=True, check=True)
    return {**json.loads(done.stdout), "before": before, "after": time.time()}


def test_the_date_is_ahead_and_clocks_of_one_robot_agree(seen: Dict[str, Any]) -> None:
    gained = (1.0 - SLOW) * (seen["after"] - seen["before"] + 1.0)  # what a slow clock may lose meanwhile
    for date in seen["dates"]:
        assert seen["before"] + AHEAD - gained < date < seen["after"] + AHEAD
    assert seen["since_boot"] >= -TICK


def test_its_seconds_are_longer(seen: Dict[str, Any]) -> None:
    (u0, m0, v0), (u1, m1, v1) = seen["start"], seen["end"]
    assert SLOW * (u1 - v0 - TICK) <= m1 - m0 <= SLOW * (v1 - u0 + TICK)


@pytest.mark.parametrize("way", ["event", "sleep", "queue", "gRPC"])
def test_a_wait_ends_when_its_own_clock_says_so(seen: Dict[str, Any], way: str) -> None:
    assert seen["waits"][way] >= 0.499


def test_a_robot_without_a_clock_of_its_own_has_the_machines(tmp_path: Path) -> None:
    assert Clocks({}, tmp_path).environment("ann") == {}
    assert not list(tmp_path.iterdir())
