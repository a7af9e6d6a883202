# SPDX-License-Identifier: Apache-2.0
"""A fleet under faults: hubs, links, robots, and what is seen of them."""

import os
import random
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Set, Tuple

from chaos.judging.events import Event

from fleet.clocks import Clock, Clocks
from fleet.hubs import Hubs
from fleet.ledger import Ledger
from fleet.network import FleetNetwork
from fleet.robot import Robot
from fleet.setup import FLEET, allow_robots, launch_arguments, make_keys
from fleet.small_disk import SmallDisk
from merlin_fleet.certificates import Folder
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_request import FleetRequest

LIMIT = 180.0  # s for anything that has to happen; a busy machine is slow, not wrong
PORT = 11311  # of the master, in each robot's own namespace
HUB_DISK, ROBOT_DISK = 2000, 4  # MB, taken as they are written


class Late(Exception):
    """Something has not happened in time; the text says what."""


class Seen(NamedTuple):
    """A change of a goal, as the fleet says."""

    at: float
    goal: str
    owner: str
    outcome: str
    """Empty: it has not ended."""


class Fleet:
    """Starts it; each robot in a network namespace of its own.

    :param names: of the robots.
    :param folder: takes all logs.
    :param drive: s of a drive.
    :param clocks: of robots that do not have the machine's clock.
    """

    def __init__(
        self, names: List[str], folder: Path, drive: float, clocks: Optional[Dict[str, Clock]] = None
    ) -> None:
        self.drive = drive
        self.ledger = Ledger()
        self.changed = threading.Condition()  # guards what is seen
        self.seen: List[Seen] = []
        self.forgetful: Set[str] = set()
        """Robots that have forgotten what is checked."""
        self.network = FleetNetwork(f"fleet{os.getpid()}", names, dict(os.environ), folder)
        self._closing: List[Callable[[], None]] = [self.network.close]
        self._folder, self._names = folder, names
        self._requests: List[FleetRequest] = []
        self._closed = False
        self.robots: Dict[str, Robot] = {}
        try:
            self._clocks = Clocks(clocks or {}, folder)
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self) -> None:
        keys = make_keys(self.network, self._names, self._folder)
        self.hub_disk = SmallDisk(self._folder / "hub_disk", HUB_DISK)
        self._closing.append(self.hub_disk.close)
        self.hubs = Hubs(keys, self.hub_disk.path)
        self._closing.append(self.hubs.close)
        allow_robots(keys, f"127.0.0.1:{self.hubs.ports[0]}")
        endpoints = [f"127.0.0.1:{port}" for port in self.hubs.ports]
        self.client = FleetClient(FLEET, endpoints, Folder(keys).tls("client.desk"))
        self._closing.append(self.client.close)
        self._news = threading.Thread(target=self._follow, name="fleet news", daemon=True)
        self._news.start()
        self.disks = {}
        for name in self._names:
            self.disks[name] = SmallDisk(self._folder / f"disk_{name}", ROBOT_DISK)
            self._closing.append(self.disks[name].close)
            self.start(name)

    def start(self, name: str) -> None:
        """Starts a robot, for the first time or again."""
        given = [*launch_arguments(name, self.network, self.hubs.ports, self._folder)]
        given = [word for word in given if not word.startswith("outbox:=")]
        given += [f"outbox:={self.disks[name].path}/outbox.sqlite", f"drive_duration:={self.drive}"]
        if name in self.robots:
            self.robots[name].close()
        self.robots[name] = Robot(
            name,
            given,
            lambda command: self.network.inside(name, command),
            PORT,
            self._folder,
            lambda event: self._take(name, event),
            self._clocks.environment(name),
        )

    def send(self, goals: List[str], **options: Any) -> List[FleetRequest]:
        """Sends goals; what happened before no longer counts."""
        with self.changed:
            self.ledger, self.seen = Ledger(), []
            self._requests = []
        requests = [self.client.send(goal, **options) for goal in goals]
        with self.changed:
            self._requests = requests
        return requests

    def joined(self) -> Set[str]:
        """The robots that are in the fleet."""
        return {robot.name for robot, joined in self.client.robots() if joined}

    def running(self) -> List[str]:
        """Robots that execute a goal."""
        return [name for name in self.robots if self.ledger.running(name)]

    def until(self, holds: Callable[[], Any], what: str, limit: float = LIMIT) -> Any:
        """Waits until something holds.

        :raises Late: when it does not within the limit, s.
        """
        end = time.monotonic() + limit
        with self.changed:
            while True:
                found = holds()
                if found:
                    return found
                left = end - time.monotonic()
                if left <= 0:
                    raise Late(f"not within {limit:g} s: {what}")
                self.changed.wait(min(left, 0.5))  # the end of a process sends no event

    def pause(self, seconds: float) -> None:
        """Lets time pass: the moment of a fault is drawn."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end, "time", seconds + LIMIT)

    def close(self) -> None:
        """Ends everything."""
        self._closed = True
        for robot in self.robots.values():
            robot.close()
        while self._closing:
            self._closing.pop()()

    def _take(self, robot: str, event: Event) -> None:
        """What a robot's Executor does."""
        with self.changed:
            if event.kind == "begun":
                self.ledger.begin(robot, event.data["goal"], event.at)
            elif event.kind == "ended" and self.robots[robot].alive:
                self.ledger.end(robot, event.data["goal"], event.at, event.data["outcome"])
            elif event.kind == "forgot":
                self.forgetful.add(robot)
            self.changed.notify_all()

    def _follow(self) -> None:
        """Notes what the fleet says of the goals."""
        reported: Dict[str, Tuple[str, str]] = {}
        while not self._closed:
            self.client.wait(lambda known=reported: self._closed or self._states() != known, 1.0)  # type: ignore[misc]
            states, now = self._states(), time.monotonic()
            with self.changed:
                for goal, (owner, outcome) in states.items():
                    if reported.get(goal) != (owner, outcome):
                        self.seen.append(Seen(now, goal, owner, outcome))
                self.changed.notify_all()
            reported = states

    def _states(self) -> Dict[str, Tuple[str, str]]:
        states = {}
        for request in self._requests:
            news = request.news
            if news is not None:
                states[request.id] = (news.owner, news.report.outcome if news.report else "")
        return states


def drawn_goals(chance: random.Random, count: int) -> List[str]:
    """Different rooms."""
    return [f"(checked room_{number})" for number in chance.sample(range(1, 7), count)]


def first_owner_after(seen: List[Seen], goal: str, at: float, victim: str) -> Optional[float]:
    """When another robot than the victim had a goal, after a moment; None: none had."""
    return next(
        (each.at for each in seen if each.goal == goal and each.at > at and each.owner not in ("", victim)),
        None,
    )
