"""The server's side of a lease: notices that the owner of a goal is silent, gone, or back."""

import threading
import traceback
from collections import deque
from typing import Callable, Deque, List, Optional

import rospy
from merlin_msgs.msg import Lease

from merlin_ros.actions.lease import LOSE_AFTER, SUSPEND_AFTER, LeaseBook, LeaseChange, LeaseState
from merlin_ros.actions.peers import connected_peers
from merlin_ros.alarms import TICK, TickClock


class LeaseWatch:
    """Watches the leases of the goals of one server.

    :param topic: ``<action>/lease``.
    :param on_change: called with each change, in order, in a thread of this watch without its lock.
    :param lose_after: s of an owner's silence after which its goals are lost.
    """

    def __init__(
        self,
        topic: str,
        on_change: Callable[[LeaseChange], None],
        lose_after: float = LOSE_AFTER,
    ) -> None:
        self.topic = rospy.resolve_name(topic)
        self._on_change = on_change
        self._changed = threading.Condition()  # guards the fields below
        self._book = LeaseBook(SUSPEND_AFTER, lose_after)
        self._pending: Deque[LeaseChange] = deque()
        self._stopped = False
        self._thread: Optional[threading.Thread] = None
        self._subscriber = rospy.Subscriber(self.topic, Lease, self._receive, tcp_nodelay=True)

    def arrive(self, goal: str, client: str = "") -> None:
        """A goal is received.

        :param client: the node that sent it, where the id of the goal does not say whether it is leased: it
            is when that node publishes leases here, or has done so.
        """
        connected = bool(client) and client in connected_peers(self._subscriber)
        with self._changed:
            leases = connected or self._book.leases(client)
            self._book.arrive(goal, client if leases else "")
            if self._book.watching:
                self._begin()

    def state(self, goal: str) -> LeaseState:
        """The state of a goal."""
        with self._changed:
            return self._book.state(goal)

    def reason(self, goal: str) -> str:
        """Why it is in that state, as part of a sentence; empty when it is held or foreign."""
        with self._changed:
            return self._book.reason(goal)

    def tell(self, goal: str) -> None:
        """Calls `on_change` with the state of a goal once more, unless its owner lives.

        For a caller that could not take the change in when it came.
        """
        told = LeaseState.HELD
        while True:
            with self._changed:
                change = LeaseChange(goal, self._book.state(goal), self._book.reason(goal))
            if change.state in (told, LeaseState.FOREIGN):
                return
            self._on_change(change)
            # If it has changed since, the thread of this watch may have said so before this.
            told = change.state

    def owner(self, goal: str) -> str:
        """The node that holds a goal, or held it last; empty: no lease ever named it."""
        with self._changed:
            return self._book.owner(goal)

    def goals_of(self, owner: str) -> List[str]:
        """The goals that a node holds, the youngest last."""
        with self._changed:
            return self._book.goals_of(owner)

    def forget(self, goal: str) -> None:
        """A goal has ended."""
        with self._changed:
            self._book.forget(goal)

    def shutdown(self) -> None:
        """Watches no more."""
        self._subscriber.unregister()
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def _receive(self, lease: Lease) -> None:
        with self._changed:
            if self._stopped:
                return
            self._add(self._book.renew(lease.owner, lease.life, lease.held, lease.suspended))
            self._begin()

    def _begin(self) -> None:
        """Watches from now on; called with the lock held."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._watch, name=f"owners {self.topic}", daemon=True)
            self._thread.start()
        elif self._book.watching:
            self._changed.notify_all()

    def _add(self, changes: List[LeaseChange]) -> None:
        if changes:
            self._pending.extend(changes)
            self._changed.notify_all()

    def _watch(self) -> None:
        ticks = TickClock()
        while not rospy.is_shutdown():
            with self._changed:
                if not self._pending and not self._stopped:
                    self._changed.wait(TICK if self._book.watching else None)
                if self._stopped:
                    return
                self._add(self._book.pass_time(ticks.look(), connected_peers(self._subscriber)))
                changes = list(self._pending)
                self._pending.clear()
            for change in changes:
                try:
                    self._on_change(change)
                except Exception:  # every other goal is still to be watched
                    rospy.logerr(f"{self.topic}: {change.goal}: {traceback.format_exc()}")
