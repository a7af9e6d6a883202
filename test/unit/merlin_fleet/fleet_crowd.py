# SPDX-License-Identifier: Apache-2.0
"""Many agents over a simulated store, which may see changes late; an execution takes no time."""

import bisect
import sys
from typing import Callable, Dict, List, Optional, Tuple

from fakes.simulated_store import SimulatedStore

from merlin_fleet.core import events as ev
from merlin_fleet.core import records
from merlin_fleet.core.agent import Agent
from merlin_fleet.core.auction import lot
from merlin_fleet.core.records import Goal, Keys, Profile
from merlin_fleet.core.reporting import Outbox
from merlin_fleet.core.store import Put, Txn

KEYS = Keys("lab")
TTL = 15.0
STEP = 0.05  # s


class Crowd:
    """Robots over a simulated store; each looks at what came every `STEP`."""

    def __init__(self, robots: int) -> None:
        self.store = SimulatedStore()
        profiles = [Profile(f"r{n}", capabilities=("arm",) if n == 3 else ()) for n in range(robots)]
        self.agents = [Agent("lab", each, f"life of {each.name}", Outbox()) for each in profiles]
        self.now = 0.0
        self.begun: List[Tuple[str, str]] = []
        self.best: Dict[str, str] = {}
        self.lost_claims = 0
        """How many claims were."""
        self.behind = 0.0
        """s after which robots see changes."""
        self._lengths: List[Tuple[float, int]] = []  # of the store's history, at each moment
        self._cursors: List[Optional[int]] = [None] * robots
        self._inboxes: List[List[ev.Event]] = [[] for _ in range(robots)]

    def send(self, count: int) -> None:
        """A client sends goals."""
        for _ in range(count):
            goal = Goal(f"g{len(self.best)}", ("(done)",), self.now)
            self.best[goal.id] = min((lot(goal.id, a.robot.name), a.robot.name) for a in self.agents)[1]
            self.store.transact(Txn((), (Put(KEYS.key(records.GOALS, goal.id), records.encode(goal)),)))

    def written(self, kind: str) -> int:
        """How often keys of a kind were written."""
        return sum(
            KEYS.parts(change.key)[0] == kind and change.value is not None for change in self.store.changes
        )

    def until(self, holds: Callable[[], bool]) -> None:
        """Goes on until something holds."""
        end = self.now + 300.0
        while not holds():
            assert self.now < end, "it does not happen"
            self.now += STEP
            self.store.pass_time(STEP)
            self._lengths.append((self.now, len(self.store.changes)))
            for index in range(len(self.agents)):
                self._act(index)

    def _act(self, index: int) -> None:
        inbox, self._inboxes[index] = self._inboxes[index], []
        cursor = self._cursors[index]
        seen = bisect.bisect_right(self._lengths, (self.now - self.behind, sys.maxsize)) - 1
        length = self._lengths[max(seen, 0)][1]
        if cursor is None:
            length = len(self.store.changes)
            inbox.append(ev.Connected(self.store.snapshot()))
        elif cursor < length:
            inbox.append(ev.Changed(tuple(self.store.changes[cursor:length])))
        self._cursors[index] = max(cursor or 0, length)
        if not inbox and self.now >= self.agents[index].next_moment():
            inbox.append(None)
        while inbox:
            for decision in self.agents[index].handle(self.now, inbox.pop(0)):
                self._carry_out(index, decision, inbox)

    def _carry_out(self, index: int, decision: ev.Decision, inbox: List[ev.Event]) -> None:
        if isinstance(decision, ev.AskLease):
            lease = decision.lease or self.store.grant(TTL)
            self.store.renew(lease)
            inbox.append(ev.Leased(decision.lease, self.now, lease, TTL))
        elif isinstance(decision, ev.Transact):
            result = self.store.transact(decision.txn)
            self.lost_claims += decision.tag.startswith("claim ") and not result.done
            self._inboxes[index].append(ev.Answered(decision.tag, result))
        elif isinstance(decision, ev.AskCost):
            cost = lot(decision.goal.id, self.agents[index].robot.name) * (1.0 + len(decision.behind))
            inbox.append(ev.Costed(decision.goal.id, decision.queue, cost))
        elif isinstance(decision, ev.AskTime):
            inbox.append(ev.Timed(self.now, self.now))
        elif isinstance(decision, ev.Begin):
            self.begun.append((decision.goal.id, self.agents[index].robot.name))
            self._inboxes[index].append(ev.Ended(decision.goal.id, True, "SUCCEEDED"))


def joined(robots: int, kind: Callable[[int], Crowd] = Crowd) -> Crowd:
    """A crowd whose robots are all joined."""
    crowd = kind(robots)
    crowd.until(lambda: all(agent.joined for agent in crowd.agents) and crowd.written(records.BIDS) >= robots)
    return crowd
