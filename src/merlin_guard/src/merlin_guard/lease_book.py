# SPDX-License-Identifier: Apache-2.0
"""Which goals of a motion server have a living owner, from the leases of their clients.

The guard has a book of its own beside :mod:`merlin_ros.actions.lease`, on purpose. It watches the servers to
which the other book belongs: a mistake there must not pass here too. It also answers another question. A
server keeps the state of each of its goals, and a lost goal stays lost. The guard knows no goals, only
leases; it judges from them at each moment, and of several owners the best counts.
"""

from collections import OrderedDict
from enum import Enum
from typing import Collection, FrozenSet, NamedTuple, Sequence, Tuple

from merlin_guard.settings import GuardSettings

LET_GO_GRACE = 0.2  # s in which a goal that was let go may end by itself; most have ended just then
SUSPEND_GONE_AFTER = 0.3  # s of silence after which an owner whose connection is closed moves nothing
LOSE_GONE_AFTER = 0.9  # s of silence after which an owner whose connection is closed has lost its goals
KEEP_OWNER = 60.0  # s of silence after which an owner is forgotten
KEEP_FORMER = 256  # ids an owner let go of that are remembered
KEEP_LIVES = 8  # earlier processes of an owner that are remembered
NAMES = 1000  # of a lease that count: its last ones; what it names before them counts as let go
OWNERS = 1000  # that are remembered at most; then the one that is silent for longest is forgotten


class BaseOwnership(Enum):
    """What the leases say about a goal."""

    FOREIGN = "foreign"
    """No lease ever named it."""
    HELD = "held"
    SUSPENDED = "suspended"
    """The goal must not move the base now, and may continue later."""
    LOST = "lost"


class LeaseClaim(NamedTuple):
    """The ownership of a goal and the reason, a clause about the owner; empty when it is foreign or held."""

    ownership: BaseOwnership
    reason: str = ""
    heard_at: float = 0.0
    """When its owner was last heard, s."""


FOREIGN = LeaseClaim(BaseOwnership.FOREIGN)
_RANK = {BaseOwnership.FOREIGN: 0, BaseOwnership.LOST: 1, BaseOwnership.SUSPENDED: 2, BaseOwnership.HELD: 3}


class _Owner:
    """The latest lease of one client, and what it named before."""

    def __init__(self, life: str) -> None:
        self.life = life
        self.former_lives: Tuple[str, ...] = ()
        self.heard_at = 0.0
        self.gone = False  # whether its connection is closed
        self.held: FrozenSet[str] = frozenset()
        self.suspended: FrozenSet[str] = frozenset()
        self.former: OrderedDict[str, Tuple[float, str]] = OrderedDict()  # id → when it is lost, and why


class GuardLeases:
    """The leases of the clients of one motion server. Times are s of the guard's own clock.

    :param settings: of the guard.
    """

    def __init__(self, settings: GuardSettings) -> None:
        self._settings = settings
        self._owners: OrderedDict[str, _Owner] = OrderedDict()  # the one that is silent for longest first

    def receive(
        self, owner: str, life: str, held: Sequence[str], suspended: Sequence[str], now: float
    ) -> None:
        """Takes a lease.

        :param owner: name of the client's node.
        :param life: names its process.
        :param held: ids of its goals.
        :param suspended: those of its goals whose own owner is silent.
        """
        known = self._owners.setdefault(owner, _Owner(life))
        if life in known.former_lives:
            return  # a late lease of a process that has ended
        named = known.held | known.suspended
        reborn = known.life != life
        if reborn:
            known.former_lives = (*known.former_lives[-KEEP_LIVES + 1 :], known.life)
        known.life, known.heard_at, known.gone = life, now, False
        known.suspended = frozenset(suspended[-NAMES:])
        known.held = frozenset(held[-NAMES:]) - known.suspended
        lost = (now, "has restarted") if reborn else (now + LET_GO_GRACE, "has let go of it")
        for goal_id in named - known.held - known.suspended:
            known.former[goal_id] = (lost[0], f"its owner {owner} {lost[1]}")
        for goal_id in known.held | known.suspended:
            known.former.pop(goal_id, None)
        while len(known.former) > KEEP_FORMER:
            known.former.popitem(last=False)
        self._owners.move_to_end(owner)
        while len(self._owners) > OWNERS or now - next(iter(self._owners.values())).heard_at > KEEP_OWNER:
            self._owners.popitem(last=False)

    def connected(self, owners: Collection[str]) -> None:
        """Takes the names of all clients whose connection is open."""
        for name, owner in self._owners.items():
            owner.gone = name not in owners

    def claim(self, goal_id: str, now: float) -> LeaseClaim:
        """The verdict of the leases on a goal now. Of several owners, the most permissive lease counts."""
        best = FOREIGN
        for name, owner in self._owners.items():
            claim = self._claim(name, owner, goal_id, now)
            if _RANK[claim.ownership] > _RANK[best.ownership]:
                best = claim
        return best

    def _claim(self, name: str, owner: _Owner, goal_id: str, now: float) -> LeaseClaim:
        former = owner.former.get(goal_id)
        if former is not None:
            lost_at, reason = former
            ownership = BaseOwnership.LOST if now >= lost_at else BaseOwnership.SUSPENDED
            return LeaseClaim(ownership, reason, owner.heard_at)
        suspended = goal_id in owner.suspended
        if not suspended and goal_id not in owner.held:
            return FOREIGN
        silent = now - owner.heard_at
        lose, suspend = self._settings.lose_after, self._settings.suspend_after
        if owner.gone and silent > min(LOSE_GONE_AFTER, lose):
            held, reason = BaseOwnership.LOST, f"its owner {name} is gone"
        elif owner.gone and SUSPEND_GONE_AFTER < silent <= suspend:
            held, reason = BaseOwnership.SUSPENDED, f"its owner {name} is not connected any more"
        elif silent > suspend:
            held = BaseOwnership.LOST if silent > lose else BaseOwnership.SUSPENDED
            reason = f"its owner {name} has been silent for {lose if silent > lose else suspend:g} s"
        elif suspended:
            held, reason = BaseOwnership.SUSPENDED, f"its owner {name} says that its own owner is silent"
        else:
            held, reason = BaseOwnership.HELD, ""
        return LeaseClaim(held, reason, owner.heard_at)
