# SPDX-License-Identifier: Apache-2.0
"""What a robot that never comes back has left in the store, and how the lab removes it.

A robot's keys are its own while it lives: it renews, ends and removes them. When it is gone forever, an
operator decides for it. All transactions compare that the robot is not joined: its lease has ended, and its
claims on the lease with it. What is left of its ownership are goals to finish, which no lease ends. Whether
such a goal is still executed, only the operator can know.
"""

from typing import Dict, List, NamedTuple, Tuple

from merlin_fleet.core import records
from merlin_fleet.core.records import MARK_PARTS, Goal, Keys
from merlin_fleet.core.store import Compare, Put, Txn
from merlin_fleet.core.view import FleetView

#: Writes the marks that replace those of a forgotten robot; no robot can have this name.
FORGOTTEN = "-forgotten"
MOST = 60  # keys that one transaction writes, deletes or compares: etcd takes 128


class Leavings(NamedTuple):
    """What the store has of a robot."""

    robot: str
    joined: bool
    """Whether its lease runs: then nothing is removed."""
    heard: float
    """s since 1970, by the robot's clock; 0: not known."""
    owned: Dict[str, int]
    """Goal to finish that it owns → epoch."""
    cancelled: Tuple[str, ...]
    """Those of them that were cancelled: they are over without an owner, the others are open."""
    gone: Dict[str, Tuple[str, ...]]
    """Goal that the fleet no longer has → keys of what the robot has written of it."""
    kept: Tuple[str, ...]
    """Goals that the fleet still has, and whose state is what the robot has written of them."""
    late: Tuple[str, ...]
    """Keys of its late reports."""
    facts: Tuple[str, ...]
    """Keys of its predicates."""
    only: Tuple[Goal, ...]
    """Goals that continue, and that no other robot may do."""
    known: bool
    """Whether the store has any key of it."""

    def removal(self, keys: Keys) -> List[Txn]:
        """Transactions that remove all but `kept`. The robot stays known until the last one was done."""
        key = keys.key
        away = Compare(key(records.LIVES, self.robot), 0)
        found = []
        for goal, epoch in self.owned.items():
            claim = key(records.CLAIMS, self.robot, goal)
            found.append(Txn((away, Compare(claim, epoch)), (), (claim,)))
        for goal, own in self.gone.items():
            found += [Txn((away, Compare(key(records.GOALS, goal), 0)), (), part) for part in _parts_of(own)]
        found += [Txn((away,), (), part) for part in _parts_of((*self.late, *self.facts))]
        # A claim reads from the mark that it comes too late, however late that is. So one that is removed
        # is replaced by a newer one of the same part.
        for parts in _parts_of(MARK_PARTS):
            puts = tuple(Put(key(records.TAKEN, part, FORGOTTEN), self.robot) for part in parts)
            found.append(Txn((away,), puts, tuple(key(records.TAKEN, part, self.robot) for part in parts)))
        said = (records.HALTS, records.SCHEMAS, records.STATUS, records.ROBOTS)
        found.append(Txn((away,), (), tuple(key(kind, self.robot) for kind in said)))
        return found


def leavings(keys: Keys, view: FleetView, robot: str) -> Leavings:
    """What a client sees of a robot."""
    owned = {goal: view.claims[goal].epoch for goal in sorted(view.owned_by.get(robot, ()))}
    own = view.written_by(robot)
    gone: Dict[str, Tuple[str, ...]] = {}
    kept = set()
    for goal, key in own:
        if goal in view.goals or keys.key(records.GOALS, goal) in view.unreadable:
            kept.add(goal)
        else:
            gone[goal] = (*gone.get(goal, ()), key)
    late = tuple(keys.key(records.LATE, name) for name, report in view.late.items() if report.robot == robot)
    facts = tuple(keys.key(records.FACTS, *names) for names in view.facts if names[0] == robot)
    profile = view.robots.get(robot)
    return Leavings(
        robot,
        robot in view.lives,
        profile.heard if profile is not None else 0.0,
        owned,
        tuple(goal for goal in owned if goal in view.cancels),
        gone,
        tuple(sorted(kept)),
        late,
        facts,
        tuple(
            goal
            for name, goal in view.goals.items()
            if goal.robot == robot and name not in view.cancels and view.over_since(name) is None
        ),
        bool(profile is not None or owned or own or late or facts),
    )


def _parts_of(names: Tuple[str, ...]) -> List[Tuple[str, ...]]:
    """Names, so many at a time as a transaction takes."""
    return [names[first : first + MOST] for first in range(0, len(names), MOST)]
