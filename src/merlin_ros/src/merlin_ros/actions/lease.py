# SPDX-License-Identifier: Apache-2.0
"""The book of leases: which goals of a server have a living owner (docs/reliability.md, "Ownership").

Pure: renewals and passing time go in, changes of state come out. :class:`.lease_watch.LeaseWatch` is
the ROS side of it, :class:`merlin_ros.actions.lease_holder.LeaseHolder` its counterpart in the client.
"""

from enum import Enum
from typing import Collection, Dict, List, NamedTuple, Optional, Sequence, Tuple

from merlin_ros.work.liveness import Limits, Liveness, Presence, Word

SUSPEND_AFTER = 0.6  # s of silence after which what is owned must not move
LOSE_AFTER = 3.0  # s of silence after which what is owned has to end
SUSPEND_GONE_AFTER = 0.3  # s of silence with which it must not move when the connection is closed, too
LOSE_GONE_AFTER = 0.9  # s of that after which it has to end
LIMITS = Limits(LOSE_AFTER, SUSPEND_AFTER, LOSE_GONE_AFTER, closed_silent=SUSPEND_GONE_AFTER)
UNNAMED_SUSPEND_AFTER = 2.0  # s after which a goal that says it is leased must not move without a lease
UNNAMED_LOSE_AFTER = 10.0  # s after which it has to end
LEASED = "-leased"  #: Ends the id of a goal that its client leases.
LASTING = "-lasting"  #: Ends the id of a goal that goes on without its client.
KEEP_UNKNOWN = 60.0  # s for which the end of a goal that is never forgotten is remembered
KEEP_LOST = 1000  # of them at most; then the oldest is forgotten
NAMES = 1000  # of a lease that count: its last ones


class LeaseState(Enum):
    """How a goal is owned."""

    FOREIGN = "foreign"
    """No lease ever named it: its client does not lease."""
    HELD = "held"
    """Its owner lives and wants it."""
    SUSPENDED = "suspended"
    """Its owner, or the owner of that one, is silent: it must not move anything now."""
    LOST = "lost"
    """The goal has lost its owner and has to end. This state is final."""


class LeaseChange(NamedTuple):
    """The state of a goal has changed. HELD is reported only after SUSPENDED."""

    goal: str
    state: LeaseState
    reason: str
    """Part of a sentence about the goal, empty when it is held."""
    released: bool = False
    """Whether it is lost because its living owner no longer names it."""


class _Goal:
    def __init__(self, owner: str, life: str) -> None:
        self.owner = owner
        self.life = life  # empty: no lease has named it yet
        self.state = LeaseState.FOREIGN
        self.reason = ""
        self.age = 0.0  # s since it was lost, or arrived without a lease


_UNKNOWN = _Goal("", "")


class LeaseBook:
    """The leases of one server's goals. Not thread-safe.

    :param limits: of an owner's silence: the goals of one that is SILENT are suspended, and of one that is
        GONE, they are lost.
    """

    def __init__(self, limits: Limits = LIMITS) -> None:
        self._goals: Dict[str, _Goal] = {}
        self._owners: Liveness[str] = Liveness(limits)

    @property
    def watching(self) -> bool:
        """Whether the passing of time can change anything."""
        return bool(self._goals)

    def state(self, goal: str) -> LeaseState:
        """The state of a goal."""
        return self._goals.get(goal, _UNKNOWN).state

    def reason(self, goal: str) -> str:
        """Why it is in that state."""
        return self._goals.get(goal, _UNKNOWN).reason

    def owner(self, goal: str) -> str:
        """The node that holds a goal, or held it last; empty: no lease ever named it."""
        return self._goals.get(goal, _UNKNOWN).owner

    def goals_of(self, owner: str) -> List[str]:
        """The goals that a node holds, the youngest last."""
        return [
            name
            for name, goal in self._goals.items()
            if goal.owner == owner and goal.state is not LeaseState.LOST
        ]

    @property
    def owners(self) -> List[str]:
        """The nodes that hold goals."""
        return [
            goal.owner for goal in self._goals.values() if goal.life and goal.state is not LeaseState.LOST
        ]

    def renew(
        self, owner: str, life: str, held: Sequence[str], suspended: Collection[str]
    ) -> List[LeaseChange]:
        """An owner names its goals.

        :param life: of its process.
        :param held: all of its goals.
        :param suspended: those of them whose own owner is silent.
        """
        if self._owners.heard(owner, life) is Word.IGNORED:
            return []
        changes: List[LeaseChange] = []
        released = (
            f"{owner} has let go of it" if len(held) <= NAMES else f"{owner} holds more than {NAMES} goals"
        )
        held, suspended = held[-NAMES:], frozenset(suspended)
        named = frozenset(held)
        for name, goal in self._goals.items():
            if goal.owner != owner or goal.state is LeaseState.LOST:
                continue
            if not goal.life:
                continue  # this lease may have been on its way before the goal
            if goal.life != life:
                self._set(changes, name, goal, LeaseState.LOST, f"{owner} was restarted")
            elif name not in named:
                self._set(changes, name, goal, LeaseState.LOST, released, released=True)
        for name in held:
            goal = self._goals.setdefault(name, _Goal(owner, life))
            if not goal.life:
                goal.owner, goal.life = owner, life
            if goal.state is LeaseState.LOST:
                continue
            if name in suspended:
                self._set(changes, name, goal, LeaseState.SUSPENDED, f"the owner of {owner} is silent")
            else:
                self._set(changes, name, goal, LeaseState.HELD, "")
        return changes

    def leases(self, client: str) -> bool:
        """Whether a node has ever sent a lease, as far as that is remembered."""
        return client in self._owners

    def arrive(self, goal: str, owner: str = "") -> None:
        """A goal is received. One whose client leases it is not foreign before it was named: the client may
        have died between the goal and its lease.

        :param owner: its client, where that is known to lease its goals; empty: the goal's id says so.
        """
        if owner or goal.endswith(LEASED):
            if owner and not self.goals_of(owner):
                self._owners.expect(owner)
            self._goals.setdefault(goal, _Goal(owner, ""))

    def pass_time(self, seconds: float, connected: Optional[Collection[str]] = None) -> List[LeaseChange]:
        """Time passes, as the watcher counts it.

        :param seconds: since the last call.
        :param connected: owners whose connection is open; None: not known.
        """
        self._owners.pass_time(seconds)
        changes: List[LeaseChange] = []
        for name, goal in list(self._goals.items()):
            goal.age += seconds
            if goal.state is not LeaseState.LOST:
                state, reason = self._judge(goal, connected is None or goal.owner in connected)
                if reason:
                    self._set(changes, name, goal, state, reason)
            elif goal.age > KEEP_UNKNOWN:
                del self._goals[name]
        lost = sorted((goal.age, name) for name, goal in self._goals.items() if goal.state is LeaseState.LOST)
        for _, name in lost[KEEP_LOST:]:
            del self._goals[name]
        return changes

    def _judge(self, goal: _Goal, connected: bool) -> Tuple[LeaseState, str]:
        """What a goal is now, and why; no reason: it stays what it is."""
        owner = goal.owner
        if owner and owner not in self._owners:
            self._owners.expect(owner)  # it was forgotten for another one
        presence = self._owners.presence(owner, connected)
        if presence is Presence.GONE:
            what = f"has been silent for {self._owners.silence(owner):.1f} s" if connected else "is gone"
            return LeaseState.LOST, f"its client {owner} {what}"
        if not goal.life and goal.age > UNNAMED_LOSE_AFTER:
            return LeaseState.LOST, "its client has never named it"
        if not goal.life and goal.age > UNNAMED_SUSPEND_AFTER:
            return LeaseState.SUSPENDED, "its client has not named it yet"
        return LeaseState.SUSPENDED, f"its client {owner} is silent" if presence is Presence.SILENT else ""

    def forget(self, goal: str) -> None:
        """A goal has ended."""
        self._goals.pop(goal, None)

    @staticmethod
    def _set(
        changes: List[LeaseChange],
        name: str,
        goal: _Goal,
        state: LeaseState,
        reason: str,
        released: bool = False,
    ) -> None:
        if goal.state is state:
            return
        first = goal.state is LeaseState.FOREIGN and state is LeaseState.HELD
        goal.state, goal.reason = state, reason
        if state is LeaseState.LOST:
            goal.age = 0.0
        if not first:
            changes.append(LeaseChange(name, state, reason, released))
