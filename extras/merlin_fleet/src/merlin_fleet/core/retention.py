# SPDX-License-Identifier: Apache-2.0
"""How long goals that have ended are kept, and how they are removed from the store.

An end is final: while the goal's key exists, a goal that has ended stays so, and so does one that was
cancelled and that no robot owns, as a claim compares both. So a removal that was right once stays right,
whenever it arrives and however many robots and clients send it. It takes the keys of clients, goal and
cancel, in one transaction. What robots have written of the goal is left to them: each takes its own keys
away, when its outbox has no report of it any more.
"""

from typing import Dict, List, NamedTuple

from merlin_fleet.core import records
from merlin_fleet.core.records import Keys
from merlin_fleet.core.store import Compare, Txn
from merlin_fleet.core.view import FleetView

HOUR = 3600.0  # s


class Retention(NamedTuple):
    """What is kept of goals that have ended."""

    hours: float = 168.0
    """After their end. 0: any time."""
    goals: int = 5000
    """The last ones. 0: any number."""
    grace: float = 600.0
    """s for which it was seen here as ended, whatever the clocks of others say: clients have received it."""


class Keeper:
    """Knows which goals are no longer to be kept.

    :param retention: what is kept.
    """

    def __init__(self, retention: Retention) -> None:
        self.retention = retention
        self._seen: Dict[str, float] = {}

    def due(self, view: FleetView, now: float, wall: float) -> List[str]:
        """The goals to remove, the oldest ends first.

        :param now: s, by a clock that is never set.
        :param wall: s since 1970.
        """
        keep = self.retention
        over = view.over
        if over.keys() != self._seen.keys():
            self._seen = {name: self._seen.get(name, now) for name in over}
        too_many = len(over) - keep.goals if keep.goals else 0
        limit = wall - keep.hours * HOUR if keep.hours else float("-inf")
        if too_many <= 0 and min(over.values(), default=limit) >= limit:
            return []
        oldest = sorted(over, key=lambda name: (over[name], name))
        return [
            name
            for place, name in enumerate(oldest)
            if (place < too_many or over[name] < limit) and now >= self._seen[name] + keep.grace
        ]


def removal(keys: Keys, view: FleetView, goal: str) -> Txn:
    """Removes a goal that is over, if the store has it and its end as they were seen."""
    sent, cancel = keys.key(records.GOALS, goal), keys.key(records.CANCELS, goal)
    report = view.ends.get(goal)
    if report is not None:
        proof = Compare(keys.key(records.ENDS, report.robot, goal), view.ended_at[goal])
    else:
        proof = Compare(cancel, view.cancels[goal].revision)
    return Txn((Compare(sent, view.written.get(goal, 0)), proof), (), (sent, cancel))
