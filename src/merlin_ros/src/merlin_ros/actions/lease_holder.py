# SPDX-License-Identifier: Apache-2.0
"""The client's side of a lease: says that this process lives and which goals it still wants."""

import threading
import uuid
from typing import Callable, ClassVar, Collection, Dict, Optional, Tuple

import rospy
from merlin_msgs.msg import Lease

from merlin_ros.actions.ownership import ownership
from merlin_ros.alarms import Alarm, every
from merlin_ros.publishing import OnSubscriber, publish, unregister

PERIOD = 0.15  # s of wall time between two renewals
LIFE = uuid.uuid4().hex[:12]  #: names this process


class LeaseHolder:
    """Holds leases of the goals that this process has sent to one server; thread-safe.

    All holders of a process for one server publish one lease: for a server, what a lease does not name is
    released. A lease is renewed in wall time: a paused simulator must not make its owner look dead.

    :param topic: ``<action>/lease``.
    """

    _shared: ClassVar[Dict[str, "_Lease"]] = {}
    _lock: ClassVar[threading.Lock] = threading.Lock()  # guards _shared and the count of its users

    def __init__(self, topic: str) -> None:
        self.topic = rospy.resolve_name(topic)
        with self._lock:
            if self.topic not in self._shared:
                self._shared[self.topic] = _Lease(self.topic)
            self._lease = self._shared[self.topic]
            self._lease.users += 1

    def hold(self, goal: str, owner: Optional[str] = None) -> None:
        """Leases a goal from now on.

        :param owner: the goal of this process's own server on whose behalf it was sent; None: not known.
        """
        self.exchange([goal], [], owner)

    def release(self, goal: str) -> None:
        """Leases a goal no more: it has ended, or was given up."""
        self.exchange([], [goal])

    def exchange(self, held: Collection[str], released: Collection[str], owner: Optional[str] = None) -> None:
        """Leases some goals from now on and others no more, in one message; see :meth:`hold`."""
        self._lease.exchange(self, held, released, owner)

    @property
    def watched(self) -> bool:
        """Whether a node listens to the leases."""
        return bool(self._lease.publisher.get_num_connections() > 0)

    def shutdown(self) -> None:
        """Releases every lease."""
        self._lease.release_all(self)
        with self._lock:
            self._lease.users -= 1
            last = self._lease.users == 0
            if last:
                del self._shared[self.topic]
        if last:
            self._lease.shutdown()


class _Lease:
    """The lease of this process for one server, whose topic is there before the first goal."""

    def __init__(self, topic: str) -> None:
        self.users = 0
        self._lock = threading.Lock()  # guards the fields below and the order of messages
        # goal -> its holder, and the goal on whose behalf it was sent
        self._held: Dict[str, Tuple[LeaseHolder, Optional[str]]] = {}
        self._stopped = False
        self._beat: Optional[Alarm] = None
        listener = OnSubscriber(self._greet)
        self.publisher = rospy.Publisher(topic, Lease, subscriber_listener=listener, queue_size=10)
        ownership.listen(self._renew)

    def release_all(self, holder: LeaseHolder) -> None:
        with self._lock:
            kept = {goal: each for goal, each in self._held.items() if each[0] is not holder}
            gone, self._held = len(kept) < len(self._held), kept
            if gone:
                self._publish()

    def exchange(
        self, holder: LeaseHolder, held: Collection[str], released: Collection[str], owner: Optional[str]
    ) -> None:
        with self._lock:
            before = len(self._held)
            for goal in released:
                self._held.pop(goal, None)
            gone = len(self._held) < before
            self._held.update(dict.fromkeys(held, (holder, owner)))
            if held and self._beat is None:
                self._beat = every(PERIOD, self._renew)
            if held or gone:
                self._publish()

    def shutdown(self) -> None:
        ownership.ignore(self._renew)
        with self._lock:
            self._stopped = True
        unregister(self.publisher)

    def _renew(self) -> None:
        with self._lock:
            if self._held and not self._stopped:
                self._publish()
            elif self._beat is not None:  # until the next goal
                self._beat.cancel()
                self._beat = None

    def _greet(self, publish_to_peer: Callable[[Lease], None]) -> None:
        """Names this life to a server that has connected: what an earlier one left there ends now."""
        with self._lock:
            if not self._stopped:
                publish_to_peer(self._message())

    def _publish(self) -> None:
        """Called with the lock held."""
        publish(self.publisher, self._message())

    def _message(self) -> Lease:
        message = Lease(
            owner=rospy.get_name(),
            life=LIFE,
            held=list(self._held),
            suspended=[goal for goal, (_, owner) in self._held.items() if ownership.suspended(owner)],
        )
        message.header.stamp = rospy.Time.now()
        return message
