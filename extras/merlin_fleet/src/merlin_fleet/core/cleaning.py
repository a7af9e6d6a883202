# SPDX-License-Identifier: Apache-2.0
"""A robot's part in the removal of ended goals: one robot removes them, each its own records of them."""

from collections import deque
from typing import TYPE_CHECKING, Deque, Dict, List, Optional, Set

from merlin_fleet.core import records
from merlin_fleet.core.records import Report
from merlin_fleet.core.retention import HOUR, Keeper, Retention, removal
from merlin_fleet.core.store import Compare, Txn

if TYPE_CHECKING:
    from merlin_fleet.core.agent import Agent

MOST = 4  # transactions under way, so that claims and reports do not wait behind many
REMOVE, FORGET = "remove", "forget"


class Cleaning:
    """Removes goals, and what this robot has written of goals that are gone."""

    def __init__(self, agent: "Agent") -> None:
        self._agent = agent
        self._keeper = Keeper(agent.rules.keep)
        self._look_at: Optional[float] = None
        self._queue: Deque[str] = deque()
        self._orphans: Dict[str, List[str]] = {}
        self._late_since: Dict[str, float] = {}
        self._flying: Set[str] = set()
        self._allowed = True

    def refused(self, reason: str) -> None:
        """The hub does not allow this robot to remove goals."""
        self._allowed = False
        self._queue.clear()
        self._agent.say(
            f"this robot removes no ended goals: {reason}; "
            "`fleet keep` does it, with the certificate of a client"
        )

    def answered(self, tag: str) -> None:
        """A transaction has ended."""
        self._flying.discard(tag)

    def decide(self) -> None:
        """Looks from time to time, and sends a few removals after the other."""
        agent = self._agent
        if not agent.joined or agent.leaving:
            self._look_at = None
            return
        if self._look_at is None or agent.now >= self._look_at:
            self._look_at = agent.now + agent.rules.clean_every
            elected = self._allowed and agent.robot.name == min(agent.view.lives)
            due = self._keeper.due(agent.view, agent.now, agent.wall)
            self._queue = deque(due if elected else ())
            self._orphans = self._find_orphans()
        while self._queue and len(self._flying) < MOST:
            goal = self._queue.popleft()
            if agent.view.over_since(goal) is not None:
                self._send(f"{REMOVE} {goal}", removal(agent.keys, agent.view, goal))
        while self._orphans and len(self._flying) < MOST:
            goal, own = self._orphans.popitem()
            gone = Compare(agent.keys.key(records.GOALS, goal), 0)
            self._send(f"{FORGET} {goal}", Txn((gone,), (), tuple(own)))

    def _send(self, tag: str, txn: Txn) -> None:
        if self._agent.transact(tag, txn):
            self._flying.add(tag)

    def _find_orphans(self) -> Dict[str, List[str]]:
        """Goal that is gone → what this robot has written of it, if its outbox has no report of it."""
        agent = self._agent
        view, key = agent.view, agent.keys.key
        waiting = {report.goal for report in agent.reporting.waiting}
        own = view.written_by(agent.robot.name)
        own += [(report.goal, key(records.LATE, name)) for name, report in self._old_late().items()]
        orphans: Dict[str, List[str]] = {}
        for goal, name in own:
            sent = key(records.GOALS, goal)
            if goal not in view.goals and sent not in view.unreadable and goal not in waiting:
                orphans.setdefault(goal, []).append(name)
        return orphans

    def _old_late(self) -> Dict[str, Report]:
        """Late reports of this robot that are old enough to be removed; no other key refers to them."""
        agent, keep = self._agent, self._agent.rules.keep
        own = {name: each for name, each in agent.view.late.items() if each.robot == agent.robot.name}
        self._late_since = {name: self._late_since.get(name, agent.now) for name in own}
        limit = agent.wall - (keep.hours or Retention().hours) * HOUR
        return {
            name: report
            for name, report in own.items()
            if report.at < limit and agent.now >= self._late_since[name] + keep.grace
        }
