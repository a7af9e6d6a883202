# SPDX-License-Identifier: Apache-2.0
"""Which peers live, judged by what they say and by their silence. Pure: words and passing time go in.

A peer is whatever a watcher listens to: the owner of goals, the host of a robot, an action interface. Each
process of a peer is one of its lives. Time is the watcher's own (:class:`merlin_ros.alarms.TickClock`): what
a watcher has missed is not its peers' silence. A watcher asks after each word and each look, and makes its
own changes of the answers.
"""

import math
from collections import Counter, OrderedDict
from enum import Enum
from typing import Callable, Generic, Hashable, Iterator, List, NamedTuple, Optional, TypeVar

KEEP_LIVES = 8  # of a peer, which are over, that are remembered
PEERS = 1000  # that are remembered at most: any node may name some
SLOWEST = 10.0  # times its period that a peer may take from one word to the next

Key = TypeVar("Key", bound=Hashable)


class Limits(NamedTuple):
    """What a watcher expects of its peers, in s of its own time.

    :param gone: silence after which a peer is GONE.
    :param silent: silence after which it is SILENT.
    :param closed: silence after which it is GONE when its connection is closed.
    :param keep: silence after which it may be forgotten for another one, when there are too many; negative:
        at once.
    :param period: from one word to the next. A peer that takes longer is given proportionally more of
        everything. 0: all are treated alike.
    :param settle: time behind a stall of the watcher in which what came meanwhile is read: only then the
        stall counts as silence.
    :param closed_silent: silence after which it is SILENT when its connection is closed.
    """

    gone: float
    silent: float = math.inf
    closed: float = math.inf
    keep: float = -1.0
    period: float = 0.0
    settle: float = 0.0
    closed_silent: float = math.inf


class Presence(Enum):
    """What is believed of a peer."""

    UNKNOWN = "unknown"
    """It has said nothing that is remembered."""
    ALIVE = "alive"
    SILENT = "silent"
    GONE = "gone"
    """Its silence has been too long. The same life may come back: a process that got SIGSTOP gets SIGCONT."""
    LEFT = "left"
    """It has said that it ends. Only another life comes back."""


class Word(Enum):
    """What a word of a peer means."""

    IGNORED = "ignored"
    """It does not count: it is of a life that is over, or too many peers are there."""
    COUNTS = "counts"
    REBORN = "reborn"
    """It is of another life: what the life before it did is over."""


class _Peer:
    def __init__(self, now: float, source: str) -> None:
        self.source = source
        self.life = ""
        self.over: List[str] = []  # lives
        self.heard = now
        self.since = now  # it is there
        self.gap = 0.0  # s between its last two words
        self.left = False

    def end(self) -> None:
        """Its life is over."""
        if self.life:
            self.over = [*self.over[1 - KEEP_LIVES :], self.life]
        self.life = ""


class Liveness(Generic[Key]):
    """The peers of one watcher, the one that is silent for longest first. Not thread-safe.

    :param limits: of all of them.
    :param room: peers that are remembered at most.
    :param room_of_one: those of them that one node may name; one that names more costs no other node a peer.
    :param on_forget: called with a peer that is forgotten for another one.
    """

    def __init__(
        self,
        limits: Limits,
        room: int = PEERS,
        room_of_one: int = PEERS,
        on_forget: Callable[[Key], None] = lambda key: None,
    ) -> None:
        self._limits = limits
        self._room, self._room_of_one = room, room_of_one
        self._on_forget = on_forget
        self._now = 0.0
        self._stall, self._back = 0.0, -math.inf  # s that stalls took that are not settled; their end
        self._peers: OrderedDict[Key, _Peer] = OrderedDict()
        self._named: Counter[str] = Counter()  # by each node

    def __iter__(self) -> Iterator[Key]:
        return iter(self._peers)

    def __contains__(self, key: Key) -> bool:
        return key in self._peers

    def pass_time(self, seconds: float, stalled: bool = False) -> None:
        """Time passes, as the watcher counts it.

        :param stalled: whether the watcher was held up for it, so that words may wait to be read.
        """
        settled = self._now - self._back >= self._limits.settle
        self._now += seconds
        if stalled:
            self._stall, self._back = seconds + (0.0 if settled else self._stall), self._now

    def heard(self, key: Key, life: str = "", source: str = "") -> Word:
        """A peer says that it lives.

        :param life: names its process; empty: it does not say.
        :param source: the node that says so.
        """
        peer = self._peer(key, source)
        if peer is None or life in peer.over:
            return Word.IGNORED
        reborn = peer.life not in ("", life)
        gap = self._now - peer.heard
        if reborn:
            peer.end()
        if reborn or peer.left or self._silence(peer, gap) > self._limits.gone:
            peer.since = self._now
        peer.heard, peer.gap, peer.life, peer.left = self._now, gap, life, False
        self._peers.move_to_end(key)
        return Word.REBORN if reborn else Word.COUNTS

    def expect(self, key: Key) -> None:
        """Something is expected of a peer from now on: its silence begins here."""
        peer = self._peer(key, "")
        if peer is not None:
            peer.heard = self._now
            self._peers.move_to_end(key)

    def left(self, key: Key) -> None:
        """A peer says that it ends. Its life is over."""
        if key in self._peers:
            self._peers[key].end()
            self._peers[key].left = True
            self._peers.move_to_end(key, last=False)

    def presence(self, key: Key, connected: bool = True) -> Presence:
        """What is believed of a peer now.

        :param connected: whether its connection is open; True: not known.
        """
        peer = self._peers.get(key)
        if peer is None:
            return Presence.UNKNOWN
        if peer.left:
            return Presence.LEFT
        silence, gone, silent = self.silence(key), self._limits.gone, self._limits.silent
        if not connected:
            gone, silent = min(gone, self._limits.closed), min(silent, self._limits.closed_silent)
        if silence > gone:
            return Presence.GONE
        return Presence.SILENT if silence > silent else Presence.ALIVE

    def silence(self, key: Key) -> float:
        """The silence of a peer that is remembered, s; less for one whose words come slowly.

        :raises KeyError: it is not remembered.
        """
        peer = self._peers[key]
        seconds = self._now - peer.heard
        if peer.heard < self._back and self._now - self._back < self._limits.settle:
            seconds = max(0.0, seconds - self._stall)
        return self._silence(peer, seconds)

    def age(self, key: Key) -> float:
        """For how long a peer has been there, GONE, LEFT and other lives apart, s; infinite: it is not."""
        return self._now - self._peers[key].since if key in self._peers else math.inf

    def crowded(self, source: str) -> bool:
        """Whether a node names as many peers as it may."""
        return self._named[source] >= self._room_of_one

    def _silence(self, peer: _Peer, seconds: float) -> float:
        period = self._limits.period
        return seconds / min(max(1.0, peer.gap / period), SLOWEST) if period else seconds

    def _peer(self, key: Key, source: str) -> Optional[_Peer]:
        """The peer, a new one where it is not remembered; None: there is no room for it."""
        if key not in self._peers and self._make_room(source):
            self._peers[key] = _Peer(self._now, source)
            self._named[source] += 1
        return self._peers.get(key)

    def _make_room(self, source: str) -> bool:
        """Whether one more can be remembered; the one that is silent for longest is forgotten for it."""
        crowded = self.crowded(source)
        if not crowded and len(self._peers) < self._room:
            return True
        key, peer = next(each for each in self._peers.items() if not crowded or each[1].source == source)
        if not peer.left and self._now - peer.heard <= self._limits.keep:
            return False
        del self._peers[key]
        self._named[peer.source] -= 1
        if not self._named[peer.source]:
            del self._named[peer.source]
        self._on_forget(key)
        return True
