# SPDX-License-Identifier: Apache-2.0
"""A process with many robots of a fleet: the real agents over a real hub, and bodies that only wait.

They share one connection: what 200 clients of gRPC compute is done by 200 machines otherwise.

Usage: fleet_robots.py ENDPOINT FLEET FIRST COUNT SECONDS
Says `ready` when all of them are joined; ends with its standard input, and prints then what it did.
"""

import heapq
import json
import random
import sys
import threading
import time
import uuid
from collections import Counter
from typing import Any, Dict, List, Optional, Tuple

from merlin_fleet.core.agent import Agent
from merlin_fleet.core.records import Goal, Keys, Profile
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.store import Change, Snapshot, Txn, TxnResult
from merlin_fleet.fleet_robot import FleetRobot, FleetStatus, Stopped
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener

LIMIT = 300.0  # s for all to join
SPEED = 0.1  # of the unit square's side, per s


class Clock:
    """Ends executions; one thread for all of them."""

    def __init__(self) -> None:
        self._changed = threading.Condition()  # guards the heap
        self._ends: List[Tuple[Any, ...]] = []
        threading.Thread(target=self._run, name="executions", daemon=True).start()

    def after(self, seconds: float, goal: str, ended: Stopped) -> None:
        """Ends a goal after s."""
        with self._changed:
            heapq.heappush(self._ends, (time.monotonic() + seconds, goal, ended))
            self._changed.notify()

    def _run(self) -> None:
        while True:
            with self._changed:
                while not self._ends or self._ends[0][0] > time.monotonic():
                    self._changed.wait(self._ends[0][0] - time.monotonic() if self._ends else None)
                _, _, ended = heapq.heappop(self._ends)
            ended(True, "SUCCEEDED", "")


class Waiting:
    """The body of a robot at a place: a goal costs the way to its place, and takes a stated time."""

    def __init__(self, clock: Clock, place: Tuple[float, float], seconds: float) -> None:
        self._clock = clock
        self._place = place
        self._seconds = seconds
        self.begun: List[str] = []
        self.stopped = 0

    def cost(self, goal: Goal, behind: Tuple[Goal, ...]) -> Tuple[Optional[float], str]:
        x, y = map(float, goal.goals[0].strip("()").split()[1:])
        way = ((x - self._place[0]) ** 2 + (y - self._place[1]) ** 2) ** 0.5
        return way / SPEED + self._seconds * (1 + len(behind)), ""

    def begin(self, goal: Goal, ended: Stopped) -> None:
        self.begun.append(goal.id)
        self._clock.after(self._seconds, goal.id, ended)

    def stop(self, goal: str, reason: str) -> None:
        self.stopped += 1  # it ends by itself soon, and its end counts


class SharedHub(EtcdHub, Listener):
    """One connection for many robots. Counts transactions."""

    def __init__(self, endpoint: str, keys: Keys) -> None:
        super().__init__(keys.root, [endpoint], timeout=10.0, end=keys.robots_end)
        self.sent: Counter[str] = Counter()
        self._lock_sent = threading.Lock()  # guards `sent`
        self._listeners: List[Listener] = []

    def transact(self, txn: Txn) -> TxnResult:
        kind = txn.puts[0].key.split("/")[3]
        result = super().transact(txn)
        with self._lock_sent:
            self.sent[kind if result.done else f"{kind} in vain"] += 1
        return result

    def follow(self, listener: Listener) -> None:
        self._listeners.append(listener)

    def begin(self) -> None:
        """All robots follow."""
        super().follow(self)

    def on_connected(self, snapshot: Snapshot) -> None:
        for listener in self._listeners:
            listener.on_connected(snapshot)

    def on_resumed(self) -> None:
        for listener in self._listeners:
            listener.on_resumed()

    def on_changed(self, changes: Tuple[Change, ...]) -> None:
        for listener in self._listeners:
            listener.on_changed(changes)

    def on_disconnected(self, reason: str) -> None:
        for listener in self._listeners:
            listener.on_disconnected(reason)


class Crowd:
    """The robots of this process."""

    def __init__(self, endpoint: str, fleet: str, first: int, count: int, seconds: float) -> None:
        clock = Clock()
        self.hub = SharedHub(endpoint, Keys(fleet))
        self.bodies: List[Waiting] = []
        self.robots: List[FleetRobot] = []
        self._joined: Dict[str, bool] = {}
        self._changed = threading.Condition()  # guards `_joined`
        for number in range(first, first + count):
            name, places = f"robot{number}", random.Random(number)
            body = Waiting(clock, (places.random(), places.random()), seconds)
            agent = Agent(fleet, Profile(name), uuid.uuid4().hex, Outbox())
            self.bodies.append(body)
            self.robots.append(FleetRobot(agent, self.hub, body, self._say, on_status=self._status(name)))
        for robot in self.robots:
            robot.start()
        self.hub.begin()

    def wait(self) -> None:
        """Waits until all are joined."""
        with self._changed:
            if not self._changed.wait_for(lambda: sum(self._joined.values()) == len(self.robots), LIMIT):
                raise RuntimeError(f"only {sum(self._joined.values())} robots have joined")

    def _status(self, name: str):  # type: ignore[no-untyped-def]
        def take(status: FleetStatus) -> None:
            with self._changed:
                self._joined[name] = status.joined
                self._changed.notify()

        return take

    def _say(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)


def main() -> None:
    """Runs the robots."""
    endpoint, fleet, first, count, seconds = sys.argv[1:]
    crowd = Crowd(endpoint, fleet, int(first), int(count), float(seconds))
    crowd.wait()
    print("ready", flush=True)
    sys.stdin.read()
    begun = Counter(goal for body in crowd.bodies for goal in body.begun)
    print(
        json.dumps(
            {
                "begun": begun,
                "stopped": sum(body.stopped for body in crowd.bodies),
                "sent": crowd.hub.sent,
                "cpu": time.process_time(),
            }
        ),
        flush=True,
    )


if __name__ == "__main__":
    main()
