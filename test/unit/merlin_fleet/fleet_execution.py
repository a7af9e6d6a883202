# SPDX-License-Identifier: Apache-2.0
"""What is on its way in a small fleet, and what its robots do."""

from typing import Dict, List, NamedTuple, Set, Tuple

from merlin_fleet.core import events as ev
from merlin_fleet.core.agent import Agent, Rules
from merlin_fleet.core.records import Profile
from merlin_fleet.core.reporting import Outbox

UP, HUNG, DEAD = "up", "hung", "dead"
TAKES = 3  # rounds of an execution


class Message(NamedTuple):
    """A question of a robot that is on its way to the hub."""

    robot: int
    life: str
    sent_at: float
    decision: object


class Execution:
    """What a robot's Executor does for the fleet."""

    def __init__(self, left: int = TAKES) -> None:
        self.left = left
        self.stopping = False
        self.stop_takes = 1  # rounds


class Robot:
    """A robot: its agent, and what of it outlives the agent."""

    def __init__(self, index: int, rules: Rules, rate: float) -> None:
        self.index = index
        self.name = f"r{index}"
        self.rules = rules
        self.rate = rate
        self.state = UP
        self.silence = 0
        self.lives = 0
        self.linked = True
        self.ahead = 0.0  # by which its clock is ahead of the hub's, s
        self.unfit = ""  # why it takes nothing
        self.never: Set[str] = set()  # goals for which it finds no plan
        self.heard = False  # whether its watch goes on from `cursor`
        self.follows = False  # whether its agent believes that it does
        self.slow = False  # whether what it watches comes late, while its questions are answered
        self.cursor = 0
        self.inbox: List[ev.Event] = []
        self.running: Dict[str, Execution] = {}
        self.outbox = Outbox()
        self.reported: List[tuple] = []  # what its outbox was given
        self.fleet_id = ""
        self.learned: List[ev.Learn] = []
        self.halts: List[str] = []  # who has stopped it
        self.said: List[Tuple[float, str]] = []
        self.agent: Agent = self._begin()

    def _begin(self) -> Agent:
        self.lives += 1
        self.heard, self.slow, self.inbox = False, False, []
        profile = Profile(self.name)
        return Agent("lab", profile, f"{self.name}.{self.lives}", self.outbox, self.rules, 0.0, self.fleet_id)

    def restart(self) -> None:
        """A new process, with the outbox of the one before, whose executions the Executor cancels."""
        for execution in self.running.values():
            execution.stopping = True
        self.fleet_id = self.agent.fleet_id
        self.agent = self._begin()
        self.state, self.silence = UP, 0
