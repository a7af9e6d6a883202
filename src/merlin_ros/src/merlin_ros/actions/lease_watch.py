# SPDX-License-Identifier: Apache-2.0
"""The server's side of a lease: notices that the owner of a goal is silent, gone, or back."""

import threading
from typing import Callable, List, Optional

import rospy
from merlin_msgs.msg import Lease

from merlin_ros.actions.lease import LIMITS, LOSE_AFTER, LeaseBook, LeaseChange, LeaseState
from merlin_ros.actions.peers import connected_peers
from merlin_ros.alarms import TICK, Alarm, TickClock, every
from merlin_ros.publishing import unregister
from merlin_ros.work.threads import CallQueue


class LeaseWatch:
    """Watches the leases of the goals of one server.

    :param topic: ``<action>/lease``.
    :param on_change: called with each change, in order, in a thread of this watch without its lock; None: the
        states are only asked for.
    :param lose_after: s of an owner's silence after which its goals are lost.
    """

    def __init__(
        self,
        topic: str,
        on_change: Optional[Callable[[LeaseChange], None]] = None,
        lose_after: float = LOSE_AFTER,
    ) -> None:
        self.topic = rospy.resolve_name(topic)
        self._on_change = on_change
        self._lock = threading.Lock()  # guards the fields below
        self._book = LeaseBook(LIMITS._replace(gone=lose_after))
        self._ticks = TickClock()
        self._looks: Optional[Alarm] = None
        self._stopped = False
        self._changes = CallQueue(f"owners {self.topic}")
        self._subscriber = rospy.Subscriber(self.topic, Lease, self._receive, tcp_nodelay=True)

    def arrive(self, goal: str, client: str = "") -> None:
        """A goal is received.

        :param client: the node that sent it, where the id of the goal does not say whether it is leased: it
            is when that node publishes leases here, or has done so.
        """
        connected = bool(client) and client in connected_peers(self._subscriber)
        with self._lock:
            leases = connected or self._book.leases(client)
            self._book.arrive(goal, client if leases else "")
            self._begin()

    def tell(self, goal: str) -> None:
        """Calls `on_change` with the state of a goal once more, unless its owner lives.

        For a caller that could not take the change in when it came.
        """
        last = LeaseState.HELD
        while True:
            with self._lock:
                change = LeaseChange(goal, self._book.state(goal), self._book.reason(goal))
            if change.state in (last, LeaseState.FOREIGN) or self._on_change is None:
                return
            self._on_change(change)
            # If it has changed since, the thread of the changes may have said so before this.
            last = change.state

    def beside(self, goal: str) -> List[str]:
        """The goals that the node holds that holds a goal, or held it last; the youngest last."""
        with self._lock:
            return self._book.goals_of(self._book.owner(goal))

    @property
    def owners(self) -> List[str]:
        """The nodes that hold goals."""
        with self._lock:
            return self._book.owners

    def forget(self, goal: str) -> None:
        """A goal has ended."""
        with self._lock:
            self._book.forget(goal)

    def shutdown(self) -> None:
        """Watches no more."""
        self._stopped = True
        unregister(self._subscriber)

    def _receive(self, lease: Lease) -> None:
        with self._lock:
            if self._stopped:
                return
            self._add(self._book.renew(lease.owner, lease.life, lease.held, lease.suspended))
            self._begin()

    def _begin(self) -> None:
        """Looks from now on where there is something to watch; called with the lock held."""
        if self._looks is None and self._book.watching and not self._stopped:
            self._ticks.look()
            self._looks = every(TICK, self._look)

    def _add(self, changes: List[LeaseChange]) -> None:
        if self._on_change is not None:
            for change in changes:
                self._changes.put(self._on_change, change)

    def _look(self) -> None:
        with self._lock:
            if self._book.watching and not self._stopped:
                self._add(self._book.pass_time(self._ticks.look(), connected_peers(self._subscriber)))
            elif self._looks is not None:  # until there is something to watch
                self._looks.cancel()
                self._looks = None
