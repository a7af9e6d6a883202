# SPDX-License-Identifier: Apache-2.0
"""The demonstration: goals, a link that is cut and mended, a robot that is killed, and the verdict."""

import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Set

from chaos.judging.events import Event

from fleet.ledger import Ledger
from fleet.network import FleetNetwork
from fleet.robot import Robot
from merlin_fleet.commands.fleet_command import words
from merlin_fleet.core.view import FleetGoalState
from merlin_fleet.fleet_client import FleetClient

LIMIT = 300.0  # s for anything that has to happen; a busy machine is slow, not wrong
GOALS = tuple(f"(checked room_{number})" for number in range(1, 7))


class Broken(Exception):
    """Something has not happened in time; the text says what."""


class Demonstration:
    """Plays it.

    :param client: of the fleet.
    :param robots: by name; all are starting.
    :param network: None: all are on one network, and no link can be cut.
    :param say: told what happens.
    """

    def __init__(
        self,
        client: FleetClient,
        robots: Dict[str, Robot],
        network: Optional[FleetNetwork],
        ledger: Ledger,
        say: Callable[[str], None],
    ) -> None:
        self._client = client
        self._robots = robots
        self._network = network
        self._ledger = ledger
        self._say = say
        self._changed = threading.Condition()
        self._reported: Dict[str, str] = {}
        self._closed = False
        self._news = threading.Thread(target=self._follow, name="fleet news", daemon=True)

    def take(self, robot: str, event: Event) -> None:
        """What a robot's Executor does."""
        if event.kind == "begun":
            self._say(f"{robot} begins {event.data['goal']}")
            self._ledger.begin(robot, event.data["goal"], event.at)
        elif event.kind == "ended" and self._robots[robot].alive:
            self._say(f"{robot} has ended {event.data['goal']}: {event.data['outcome']}")
            self._ledger.end(robot, event.data["goal"], event.at, event.data["outcome"])
        with self._changed:
            self._changed.notify_all()

    def play(self) -> List[str]:
        """Plays it to its end; returns what went wrong.

        :raises Broken: when something has not happened in time.
        """
        self._news.start()
        self._until(lambda: self._joined() == set(self._robots), "all robots are in the fleet")
        for goal in GOALS:
            self._client.send(goal, tries=len(self._robots))
        if self._network is not None:
            self._cut()
        self._kill()
        self._until(lambda: len(self._ends()) == len(GOALS), "every goal has ended")
        self._until(lambda: not any(self._ledger.running(name) for name in self._robots), "all robots stand")
        ends = self._ends()
        found = self._ledger.mistakes(GOALS, ends)
        return found + [f"{goal} ended as {ends[goal]}" for goal in GOALS if ends[goal] != "SUCCEEDED"]

    def close(self) -> None:
        """Ends the thread."""
        self._closed = True
        with self._changed:
            self._changed.notify_all()

    # --- what happens

    def _cut(self) -> None:
        assert self._network is not None
        cut = self._busy("a robot works")
        (goal,) = self._ledger.running(cut)
        at = time.monotonic()
        self._say(f"--- the link of {cut} is cut")
        self._network.shape(cut, loss=1.0)
        self._until(lambda: not self._ledger.running(cut), f"{cut} stops by its own clock")
        self._until(lambda: self._ledger.next_begun(goal, at), f"another robot begins {goal}")
        self._say(f"--- the link of {cut} is mended")
        self._network.shape(cut)
        self._until(lambda: cut in self._joined(), f"{cut} is in the fleet again")

    def _kill(self) -> None:
        dead = self._busy("a robot works that can be killed")
        goals = self._ledger.running(dead)
        self._say(f"--- {dead} is killed while it executes {', '.join(goals)}")
        self._robots[dead].kill()
        self._ledger.kill(dead, time.monotonic())

    def _busy(self, what: str) -> str:
        def first() -> Optional[str]:
            return next((name for name in self._robots if len(self._ledger.running(name)) == 1), None)

        found: str = self._until(first, what)
        return found

    # --- what is known

    def _joined(self) -> Set[str]:
        return {robot.name for robot, joined in self._client.robots() if joined}

    def _ends(self) -> Dict[str, str]:
        reports = {" ".join(news.goal.goals): news.report for news in self._client.goals()}
        return {goal: report.outcome for goal, report in reports.items() if report is not None}

    def _until(self, holds: Callable[[], Any], what: str) -> Any:
        end = time.monotonic() + LIMIT
        with self._changed:
            while True:
                found = holds()
                if found:
                    return found
                for name, robot in self._robots.items():
                    if robot.alive and not robot.running:
                        raise Broken(f"{name} does not run; its logs say why")
                left = end - time.monotonic()
                if left <= 0:
                    raise Broken(f"it did not happen within {LIMIT:g} s that {what}")
                self._changed.wait(min(left, 1.0))  # the end of a launch sends no event

    def _follow(self) -> None:
        """Says what the fleet says."""
        while not self._closed:
            self._client.wait(lambda: self._closed or self._states() != self._reported, 1.0)
            states = self._states()
            for what, state in states.items():
                if self._reported.get(what) != state:
                    self._say(f"hub: {what} {state}")
            self._reported = states
            with self._changed:
                self._changed.notify_all()

    def _states(self) -> Dict[str, str]:
        """Goals and robots in words; not why robots do not bid."""
        states = {}
        for news in self._client.goals():
            is_open = news.state is FleetGoalState.OPEN
            states[" ".join(news.goal.goals)] = "is open" if is_open else words(news)
        for robot, joined in self._client.robots():
            states[robot.name] = "is in the fleet" if joined else "is not in the fleet any more"
        return states


def make_folder(results: Path) -> Path:
    """A new folder for the logs of a run."""
    folder = results.absolute() / time.strftime("%Y-%m-%d_%H-%M-%S")  # the robots run elsewhere
    folder.mkdir(parents=True)
    return folder
