# SPDX-License-Identifier: Apache-2.0
"""The keys of a fleet as one robot or client sees them."""

import bisect
from enum import Enum
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Set, Tuple

from merlin_fleet.core import records
from merlin_fleet.core.auction import Offers, order, unsuited
from merlin_fleet.core.records import (
    Claim,
    Facts,
    Goal,
    Halt,
    Keys,
    Profile,
    RecordError,
    Report,
    Schema,
    Status,
)
from merlin_fleet.core.store import Change, Item, Snapshot

#: Parts of the keys that do not have two.
PARTS = {
    records.ABOUT: 1,
    records.CLAIMS: 3,
    records.ENDS: 3,
    records.FAILURES: 4,
    records.LATE: 3,
    records.TAKEN: 3,
    records.FACTS: 3,
}
#: Part of a key that names the goal whose state it is about.
GOAL_AT = {
    records.GOALS: 1,
    records.CANCELS: 1,
    records.CLAIMS: 2,
    records.ENDS: 2,
    records.FAILURES: 2,
}
#: Kinds of records of which a robot has one each, and the view a field → their class.
OF_ROBOTS = {records.ROBOTS: Profile, records.SCHEMAS: Schema, records.STATUS: Status}
#: The life of a claim that cannot be read.
UNREAD = "?"


class FleetGoalState(Enum):
    """Where a goal is."""

    OPEN = "open"
    OWNED = "owned"
    CANCELLING = "cancelling"
    """Owned, and its owner was asked to stop it."""
    CANCELLED = "cancelled"
    """Cancelled before a robot owned it, or its owner was lost afterwards."""
    ENDED = "ended"
    UNKNOWN = "unknown"


class Cancel(NamedTuple):
    """A goal was cancelled."""

    at: float
    """s since 1970, by the client's clock; 0: not known."""
    revision: int


class FleetView:
    """Follows snapshots and changes. A record that cannot be read is left out and named in `unreadable`.

    A change costs what it changes, however many goals there are: each goal stands in the list of its state.

    :param keys: of the fleet.
    :param robot: that looks; None: a client.
    """

    def __init__(self, keys: Keys, robot: Optional[Profile] = None) -> None:
        self._keys = keys
        self._robot = robot
        self.revision = 0
        self.version = 0
        """Grows with each change of the lists of open goals."""
        self.about = ""
        self.goals: Dict[str, Goal] = {}
        self.written: Dict[str, int] = {}
        """Goal → the revision at which it was sent."""
        self.claims: Dict[str, Claim] = {}
        self.cancels: Dict[str, Cancel] = {}
        self.ends: Dict[str, Report] = {}
        self.ended_at: Dict[str, int] = {}
        """Goal → the revision at which its end was written."""
        self.failures: Dict[str, Dict[str, Report]] = {}
        """Goal → epoch → how that try failed."""
        self.lives: Dict[str, Claim] = {}
        """Robot → the life that is joined, with its revision as epoch."""
        self.offers = Offers()
        self.robots: Dict[str, Profile] = {}
        self.schemas: Dict[str, Schema] = {}
        self.status: Dict[str, Status] = {}
        self.halts: Dict[str, Halt] = {}
        """Robot → the stop that it has not carried out yet."""
        self.late: Dict[str, Report] = {}
        self.facts: Dict[Tuple[str, str], Facts] = {}
        """Robot and predicate → what the robot says of it."""
        self.unreadable: Dict[str, str] = {}
        """Key → why it cannot be read."""
        self._unclear: Dict[str, str] = {}
        """Key of a claim or an end that cannot be read → its goal."""
        self.open: List[Tuple[float, float, float, str]] = []
        """Open goals that the robot can do and has not tried: how they are sorted, with the id at the end."""
        self.unsuited: List[Tuple[float, float, float, str]] = []
        """Open goals that the robot cannot do."""
        self.due: List[Tuple[float, str]] = []
        """Open goals with a deadline, the earliest first."""
        self.over: Dict[str, float] = {}
        """Goals that are over, with `over_since`."""
        self.owned_by: Dict[str, Set[str]] = {}
        """Robot → the goals that it owns."""
        self._places: Dict[str, List[Tuple[List[Any], Tuple[Any, ...]]]] = {}

    @classmethod
    def of(cls, keys: Keys, snapshot: Snapshot, robot: Optional[Profile] = None) -> "FleetView":
        """The view of a snapshot."""
        view = cls(keys, robot)
        items = sorted(snapshot.items, key=lambda item: item.modified)  # the first claim counts
        view.apply(Change(item.key, item.value, item.modified) for item in items)
        view.revision = snapshot.revision
        return view

    def apply(self, changes: Iterable[Change]) -> Dict[str, Claim]:
        """Takes changes, in their order; returns the claims that are gone, by their goals."""
        changes = tuple(changes)
        gone: Dict[str, Claim] = {}
        last = {change.key: change.modified for change in changes}
        for change in changes:
            parts = self._keys.parts(change.key)
            if not parts or (parts[0] == records.BIDS and last[change.key] != change.modified):
                continue  # of a robot's bids only the last ones count
            self.revision = max(self.revision, change.modified)
            self.unreadable.pop(change.key, None)
            self._unclear.pop(change.key, None)
            if change.value is None:
                if parts[0] == records.CLAIMS and len(parts) == PARTS[records.CLAIMS]:
                    gone[parts[2]] = self.claims.get(parts[2], Claim(parts[1], UNREAD))
                self._forget(*parts)
            else:
                self._take(Item(change.key, change.value, change.modified), *parts)
            place = GOAL_AT.get(parts[0])
            if place is not None:
                self._place(parts[min(place, len(parts) - 1)])
        return gone

    def _take(self, item: Item, *parts: str) -> None:
        try:
            if len(parts) != PARTS.get(parts[0], 2):
                raise RecordError("this version does not know such keys")
            if parts[0] in (records.GOALS, records.CANCELS):
                records.checked_name(parts[1], "the goal")  # it is part of other keys, and of tags
            self._put(item, *parts)
        except RecordError as error:
            self._forget(*parts)
            self.unreadable[item.key] = str(error)
            if parts[0] in (records.CLAIMS, records.ENDS) and parts[-1] not in self.claims:
                self._unclear[item.key] = parts[-1]

    def follows(self, before: "FleetView") -> bool:
        """Whether the store may have gone on from an earlier view to this one.

        One that was put back from a backup has less than before, or its keys have other revisions, which
        may be greater than those of before.
        """
        if self.revision < before.revision:
            return False
        pairs = zip(self._revisions(), before._revisions())
        return all(
            old.get(name) == revision
            for new, old in pairs
            for name, revision in new.items()
            if revision <= before.revision
        )

    def _revisions(self) -> Tuple[Dict[str, int], ...]:
        """When the keys of each kind were written."""
        claims, lives = ({name: it.epoch for name, it in each.items()} for each in (self.claims, self.lives))
        cancels = {name: cancel.revision for name, cancel in self.cancels.items()}
        return self.written, self.ended_at, claims, lives, cancels

    def state(self, goal: str) -> FleetGoalState:
        """The state of a goal."""
        if goal in self.ends:
            return FleetGoalState.ENDED
        if goal in self._unclear.values():
            return FleetGoalState.UNKNOWN
        if goal in self.claims:
            return FleetGoalState.CANCELLING if goal in self.cancels else FleetGoalState.OWNED
        if goal in self.cancels:
            return FleetGoalState.CANCELLED
        return FleetGoalState.OPEN if goal in self.goals else FleetGoalState.UNKNOWN

    def over_since(self, goal: str) -> Optional[float]:
        """When a goal has ended, or was cancelled before a robot had it, s since 1970; None: it continues.

        A goal that a robot still owns continues, whatever else is written of it.
        """
        if goal in self.claims:
            return None
        state = self.state(goal)
        if state is FleetGoalState.ENDED:
            return self.ends[goal].at
        if state is FleetGoalState.CANCELLED:
            sent = self.goals[goal].sent if goal in self.goals else 0.0
            return self.cancels[goal].at or sent
        return None

    def written_by(self, robot: str) -> List[Tuple[str, str]]:
        """The goal and the key of each end and each failure that a robot has written."""
        key = self._keys.key
        own = [
            (goal, key(records.ENDS, robot, goal)) for goal, end in self.ends.items() if end.robot == robot
        ]
        for goal, tries in self.failures.items():
            epochs = (epoch for epoch, report in tries.items() if report.robot == robot)
            own += [(goal, key(records.FAILURES, robot, goal, epoch)) for epoch in epochs]
        return own

    def _place(self, name: str) -> None:
        """Puts a goal into the lists of its state."""
        for place, entry in self._places.pop(name, ()):
            del place[bisect.bisect_left(place, entry)]
            self.version += 1
        since = self.over_since(name) if name in self.goals or name in self.cancels else None
        if since is not None:
            self.over[name] = since
        else:
            self.over.pop(name, None)
        if since is not None or self.state(name) is not FleetGoalState.OPEN:
            return
        self.version += 1
        goal = self.goals[name]
        places: List[Tuple[List[Any], Tuple[Any, ...]]] = []
        if self._robot is not None and unsuited(goal, self._robot):
            places.append((self.unsuited, order(goal)))
        elif not self._tried(name):
            places.append((self.open, order(goal)))
        if goal.deadline is not None:
            places.append((self.due, (goal.deadline, name)))
        for place, entry in places:
            bisect.insort(place, entry)
        self._places[name] = places

    def _tried(self, goal: str) -> bool:
        """Whether this robot has tried the goal and failed."""
        return self._robot is not None and any(
            report.robot == self._robot.name for report in self.failures.get(goal, {}).values()
        )

    def _put(self, item: Item, kind: str, *names: str) -> None:
        name = names[0] if names else ""
        if kind == records.ABOUT:
            self.about = records.decode_about(item.value)
        elif kind == records.GOALS:
            goal = records.decode_once(Goal, item.value)
            if goal.id != name:
                raise RecordError(f"it calls itself '{goal.id}'")
            self.goals[name], self.written[name] = goal, item.modified
        elif kind == records.LIVES:
            self.lives[name] = records.decode_once(Claim, item.value)._replace(epoch=item.modified)
        elif kind == records.CLAIMS:
            self._put_claim(item, *names)
        elif kind == records.CANCELS:
            self.cancels[name] = Cancel(records.decode_cancel(item.value), item.modified)
        elif kind == records.ENDS:
            goal = names[1]
            owner = self.claims[goal].robot if goal in self.claims else name
            if owner != name:
                raise RecordError(f"{owner} owns the goal")
            report = _report_of(item, name)
            if self.ends.setdefault(goal, report) is report:
                self.ended_at[goal] = item.modified
        elif kind == records.FAILURES:
            self.failures.setdefault(names[1], {})[names[2]] = _report_of(item, name)
        elif kind == records.BIDS:
            self.offers.put(name, records.decode_bids(item.value))
        elif kind in OF_ROBOTS:
            getattr(self, kind)[name] = records.decode(OF_ROBOTS[kind], item.value)
        elif kind == records.HALTS:
            self.halts[name] = records.decode(Halt, item.value)._replace(revision=item.modified)
        elif kind == records.LATE:
            self.late["/".join(names)] = _report_of(item, name)
        elif kind == records.FACTS:
            facts = records.decode(Facts, item.value)
            if (facts.robot, facts.predicate) != names:
                raise RecordError(f"it is '{facts.predicate}' of {facts.robot}")
            self.facts[(facts.robot, facts.predicate)] = facts
        elif kind == records.TAKEN:
            pass  # only their revisions matter, to the store
        else:
            raise RecordError("this version does not know such keys")

    def _put_claim(self, item: Item, robot: str, goal: str) -> None:
        claim = records.decode_once(Claim, item.value)._replace(epoch=item.modified)
        if claim.robot != robot:
            raise RecordError(f"it is of {claim.robot}")
        first = self.claims.get(goal, claim)
        if first.robot != robot:
            raise RecordError(f"{first.robot} has claimed the goal before")
        self.claims[goal] = claim
        self.owned_by.setdefault(robot, set()).add(goal)

    def _forget(self, kind: str, *names: str) -> None:
        name = names[0] if names else ""
        if 1 + len(names) != PARTS.get(kind, 2):
            return
        if kind == records.ABOUT:
            self.about = ""
        elif kind == records.CANCELS:
            self.cancels.pop(name, None)
        elif kind == records.FAILURES:
            self.failures.get(names[1], {}).pop(names[-1], None)
            if not self.failures.get(names[1], True):
                del self.failures[names[1]]
        elif kind in (records.CLAIMS, records.ENDS):
            known = getattr(self, kind)
            if names[1] in known and known[names[1]].robot == name:
                del known[names[1]]
                if kind == records.ENDS:
                    del self.ended_at[names[1]]
                if kind == records.CLAIMS:
                    self.owned_by[name].discard(names[1])
        elif kind == records.LATE:
            self.late.pop("/".join(names), None)
        elif kind == records.FACTS:
            self.facts.pop((names[0], names[1]), None)
        elif kind in (records.LIVES, records.BIDS):
            if kind == records.LIVES:
                self.lives.pop(name, None)
            if self.offers.of(name) is not None:
                self.offers.remove(name)
        elif kind in (records.GOALS, records.HALTS, *OF_ROBOTS):
            getattr(self, kind).pop(name, None)
            if kind == records.GOALS:
                self.written.pop(name, None)


def _report_of(item: Item, robot: str) -> Report:
    """A report that is below the key of its robot.

    :raises RecordError: for any other.
    """
    report: Report = records.decode_once(Report, item.value)
    if report.robot != robot:
        raise RecordError(f"it is of {report.robot}")
    return report
