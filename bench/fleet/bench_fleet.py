# SPDX-License-Identifier: Apache-2.0
"""A fleet of 200 robots and 5 000 goals over a real etcd, on one machine, without ROS."""

import json
import os
import random
import subprocess
import sys
import threading
import time
import urllib.request
from collections import Counter
from pathlib import Path
from typing import Any, Dict, List, Tuple

from measuring.figures import figure

from merlin_fleet.core import records
from merlin_fleet.core.records import Goal, Keys
from merlin_fleet.core.store import Change, Compare, Put, Snapshot, Txn
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener
from merlin_test.etcd_process import DIRECT, EtcdProcess

ROBOTS = int(os.environ.get("FLEET_ROBOTS", 200))
GOALS = int(os.environ.get("FLEET_GOALS", 5_000))
SINGLE = 50  # goals that come one by one, to an idle fleet
EVERY = 1.0  # s between them
SECONDS = 1.0  # an execution takes
PROCESSES = 2
LIMIT = 1500.0  # s for anything to happen
KEYS = Keys("bench")
METRICS = {
    "mvcc_events": "etcd_debugging_mvcc_events_total",
    "resident": "process_resident_memory_bytes",
    "sent_bytes": "etcd_network_client_grpc_sent_bytes_total",
    "database": "etcd_mvcc_db_total_size_in_bytes",
    "cpu": "process_cpu_seconds_total",
}


class Watcher(Listener):
    """Sees when goals have an owner and when they have ended."""

    def __init__(self) -> None:
        self.claimed: Dict[str, float] = {}
        self.ended: Dict[str, float] = {}
        self.changed = threading.Condition()  # guards the fields above
        self.connected = threading.Event()

    def on_connected(self, snapshot: Snapshot) -> None:
        self.connected.set()

    def on_changed(self, changes: Tuple[Change, ...]) -> None:
        now = time.monotonic()
        with self.changed:
            for change in changes:
                kind, *names = KEYS.parts(change.key)
                if kind in (records.CLAIMS, records.ENDS) and change.value is not None:
                    (self.claimed if kind == records.CLAIMS else self.ended).setdefault(names[-1], now)
            self.changed.notify_all()

    def wait(self, count: int) -> None:
        """Waits until so many goals have ended."""
        with self.changed:
            if not self.changed.wait_for(lambda: len(self.ended) >= count, LIMIT):
                raise RuntimeError(f"only {len(self.ended)} of {count} goals have ended")


class Robots:
    """The processes of the robots."""

    def __init__(self, endpoint: str) -> None:
        script = str(Path(__file__).with_name("fleet_robots.py"))
        share = ROBOTS // PROCESSES
        self._processes = [
            subprocess.Popen(
                [sys.executable, script, endpoint, "bench", str(n * share), str(share), str(SECONDS)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for n in range(PROCESSES)
        ]
        for process in self._processes:
            assert process.stdout is not None
            if process.stdout.readline().strip() != "ready":
                raise RuntimeError("the robots do not join")

    def end(self) -> List[Dict[str, Any]]:
        """Ends them; returns what they did."""
        outputs = [process.communicate(timeout=60.0)[0] for process in self._processes]
        return [json.loads(output.strip().splitlines()[-1]) for output in outputs]

    def kill(self) -> None:
        """Ends them in any case."""
        for process in self._processes:
            process.kill()
            process.wait()


class Client:
    """Sends goals."""

    def __init__(self, hub: EtcdHub) -> None:
        self._hub = hub
        self._random = random.Random(1)
        self.sent: Dict[str, float] = {}

    def send(self) -> None:
        """Sends one."""
        name = f"g{len(self.sent)}"
        x, y = self._random.random(), self._random.random()
        goal = Goal(name, (f"(at {x:.4f} {y:.4f})",), time.time())
        key = KEYS.key(records.GOALS, name)
        self.sent[name] = time.monotonic()
        assert self._hub.transact(Txn((Compare(key, 0),), (Put(key, records.encode(goal)),))).done


def metrics(endpoint: str) -> Dict[str, float]:
    """What etcd counts."""
    with DIRECT.open(urllib.request.Request(f"http://{endpoint}/metrics"), timeout=10.0) as answer:
        lines = answer.read().decode().splitlines()
    found = {line.split(" ")[0]: float(line.split(" ")[1]) for line in lines if not line.startswith("#")}
    return {name: found[metric] for name, metric in METRICS.items()}


def measure() -> Dict[str, Any]:
    """Keys: fleet_*."""
    etcd = EtcdProcess()
    hub = EtcdHub(KEYS.root, [etcd.endpoint], timeout=20.0)
    watcher, client = Watcher(), Client(hub)
    robots = None
    try:
        hub.follow(watcher)
        assert watcher.connected.wait(LIMIT)
        began = time.monotonic()
        robots = Robots(etcd.endpoint)
        joined = time.monotonic() - began
        for _ in range(SINGLE):
            client.send()
            time.sleep(EVERY)  # the pace of the load
        watcher.wait(SINGLE)
        before = metrics(etcd.endpoint)
        began = time.monotonic()
        for _ in range(GOALS):
            client.send()
        sending = time.monotonic() - began
        watcher.wait(SINGLE + GOALS)
        took = time.monotonic() - began
        after = metrics(etcd.endpoint)
        done = robots.end()
    finally:
        if robots is not None:
            robots.kill()
        hub.close()
        etcd.close()
    return {"fleet_robots": ROBOTS, "fleet_goals": GOALS, "fleet_join_s": round(joined, 1)} | results(
        watcher, client, done, before, after, took, sending
    )


def results(
    watcher: Watcher,
    client: Client,
    done: List[Dict[str, Any]],
    before: Dict[str, float],
    after: Dict[str, float],
    took: float,
    sending: float,
) -> Dict[str, Any]:
    """The figures."""
    begun = sum((Counter(each["begun"]) for each in done), Counter())
    sent = sum((Counter(each["sent"]) for each in done), Counter())
    assign = {name: watcher.claimed[name] - moment for name, moment in client.sent.items()}
    names = list(client.sent)
    return {
        "fleet_goals_per_s": round(GOALS / took, 1),
        "fleet_send_s": round(sending, 1),
        "fleet_assign_single_s": figure([assign[name] for name in names[:SINGLE]]),
        "fleet_assign_many_s": figure([assign[name] for name in names[SINGLE:]]),
        "fleet_done_twice": sum(count > 1 for count in begun.values()),
        "fleet_lost": sum(name not in begun for name in names),
        "fleet_stopped": sum(each["stopped"] for each in done),
        "fleet_transactions_per_goal": {
            kind: round(count / len(names), 2) for kind, count in sorted(sent.items())
        },
        "fleet_changes_sent_per_goal": round((after["mvcc_events"] - before["mvcc_events"]) / GOALS),
        "fleet_kilobytes_sent_per_goal": round((after["sent_bytes"] - before["sent_bytes"]) / GOALS / 1e3),
        "fleet_etcd_memory_mb": round(after["resident"] / 1e6),
        "fleet_etcd_database_mb": round(after["database"] / 1e6, 1),
        "fleet_cpu_s": {
            "etcd": round(after["cpu"] - before["cpu"], 1),
            "robots": round(sum(each["cpu"] for each in done), 1),
        },
    }
