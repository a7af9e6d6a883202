"""The book of leases: which goals of a server have a living owner (docs/reliability.md, "Ownership").

Pure: renewals and passing time go in, changes of state come out. :class:`.lease_watch.LeaseWatch` is
the ROS side of it, :class:`merlin_ros.actions.lease_holder.LeaseHolder` its counterpart in the client.
"""

from collections import OrderedDict
from enum import Enum
from typing import Collection, Dict, List, NamedTuple, Optional, Sequence

SUSPEND_AFTER = 0.6  # s of silence after which what is owned must not move
LOSE_AFTER = 3.0  # s of silence after which what is owned has to end
LOSE_GONE_AFTER = 0.9  # s of that when the connection to the owner is closed, too
UNNAMED_SUSPEND_AFTER = 2.0  # s after which a goal that says it is leased must not move without a lease
UNNAMED_LOSE_AFTER = 10.0  # s after which it has to end
LEASED = "-leased"  #: Ends the id of a goal that its client leases.
KEEP_LIVES = 8  # earlier processes of an owner that are remembered
KEEP_UNKNOWN = 60.0  # s for which the end of a goal that is never forgotten is remembered
KEEP_LOST = 1000  # of them at most; then the oldest is forgotten
NAMES = 1000  # of a lease that count: its last ones
OWNERS = 1000  # whose lives are remembered at most; then the one that was heard first is forgotten


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
    let_go: bool = False
    """Whether it is lost because its living owner no longer names it."""


class _Goal:
    def __init__(self, owner: str, life: str) -> None:
        self.owner = owner
        self.life = life  # empty: no lease has named it yet
        self.state = LeaseState.FOREIGN
        self.reason = ""
        self.age = 0.0  # s since it was lost, or arrived without a lease


class LeaseBook:
    """The leases of one server's goals. Not thread-safe.

    :param suspend_after: s of an owner's silence after which its goals are suspended.
    :param lose_after: s of silence after which they are lost.
    :param lose_gone_after: likewise, when the owner's connection is closed.
    """

    def __init__(
        self,
        suspend_after: float = SUSPEND_AFTER,
        lose_after: float = LOSE_AFTER,
        lose_gone_after: float = LOSE_GONE_AFTER,
    ) -> None:
        self._suspend_after = suspend_after
        self._lose_after = lose_after
        self._lose_gone_after = lose_gone_after
        self._goals: Dict[str, _Goal] = {}
        self._silence: Dict[str, float] = {}  # owner -> s
        #: Owner -> its lives, the present one last. The owner that was heard last is the last, too.
        self._lives: OrderedDict[str, List[str]] = OrderedDict()

    @property
    def watching(self) -> bool:
        """Whether the passing of time can change anything."""
        return bool(self._goals)

    def state(self, goal: str) -> LeaseState:
        """The state of a goal."""
        known = self._goals.get(goal)
        return LeaseState.FOREIGN if known is None else known.state

    def reason(self, goal: str) -> str:
        """Why it is in that state."""
        known = self._goals.get(goal)
        return "" if known is None else known.reason

    def owner(self, goal: str) -> str:
        """The node that holds a goal, or held it last; empty: no lease ever named it."""
        known = self._goals.get(goal)
        return "" if known is None else known.owner

    def goals_of(self, owner: str) -> List[str]:
        """The goals that a node holds, the youngest last."""
        return [
            name
            for name, goal in self._goals.items()
            if goal.owner == owner and goal.state is not LeaseState.LOST
        ]

    def renew(
        self, owner: str, life: str, held: Sequence[str], suspended: Collection[str]
    ) -> List[LeaseChange]:
        """An owner names its goals.

        :param life: of its process.
        :param held: all of its goals.
        :param suspended: those of them whose own owner is silent.
        """
        lives = self._lives.setdefault(owner, [])
        self._lives.move_to_end(owner)
        if len(self._lives) > OWNERS:
            gone, _ = self._lives.popitem(last=False)
            self._silence.pop(gone, None)
        if life in lives[:-1]:
            return []  # a late lease of a process that has ended
        if life not in lives:
            self._lives[owner] = [*lives[-KEEP_LIVES:], life]
        self._silence[owner] = 0.0
        changes: List[LeaseChange] = []
        let_go = (
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
                self._set(changes, name, goal, LeaseState.LOST, let_go, let_go=True)
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
        return client in self._lives

    def arrive(self, goal: str, owner: str = "") -> None:
        """A goal is received. One whose client leases it is not foreign before it was named: the client may
        have died between the goal and its lease.

        :param owner: its client, where that is known to lease its goals; empty: the goal's id says so.
        """
        if owner or goal.endswith(LEASED):
            self._goals.setdefault(goal, _Goal(owner, ""))

    def pass_time(self, seconds: float, connected: Optional[Collection[str]] = None) -> List[LeaseChange]:
        """Time passes, as the watcher counts it.

        :param seconds: since the last call.
        :param connected: owners whose connection is open; None: not known.
        """
        changes: List[LeaseChange] = []
        owners = {goal.owner for goal in self._goals.values() if goal.state is not LeaseState.LOST}
        self._silence = {owner: self._silence.get(owner, 0.0) + seconds for owner in owners}
        for name, goal in list(self._goals.items()):
            if goal.state is LeaseState.LOST:
                goal.age += seconds
                if goal.age > KEEP_UNKNOWN:
                    del self._goals[name]
                continue
            if not goal.life:
                goal.age += seconds
                if goal.age > UNNAMED_LOSE_AFTER:
                    self._set(changes, name, goal, LeaseState.LOST, "its client has never named it")
                    goal.age = 0.0
                    continue
                if goal.age > UNNAMED_SUSPEND_AFTER:
                    self._set(changes, name, goal, LeaseState.SUSPENDED, "its client has not named it yet")
            if not goal.owner:
                continue
            silence = self._silence[goal.owner]
            gone = connected is not None and goal.owner not in connected
            lose_after = self._lose_gone_after if gone else self._lose_after
            if silence > lose_after:
                what = "is gone" if gone else f"has been silent for {silence:.1f} s"
                self._set(changes, name, goal, LeaseState.LOST, f"its client {goal.owner} {what}")
            elif silence > self._suspend_after:
                self._set(changes, name, goal, LeaseState.SUSPENDED, f"its client {goal.owner} is silent")
        self._forget_lost()
        return changes

    def _forget_lost(self) -> None:
        lost = [(goal.age, name) for name, goal in self._goals.items() if goal.state is LeaseState.LOST]
        for _, name in sorted(lost, reverse=True)[: max(0, len(lost) - KEEP_LOST)]:
            del self._goals[name]

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
        let_go: bool = False,
    ) -> None:
        if goal.state is state:
            return
        first = goal.state is LeaseState.FOREIGN and state is LeaseState.HELD
        goal.state, goal.reason = state, reason
        if not first:
            changes.append(LeaseChange(name, state, reason, let_go))
