# SPDX-License-Identifier: Apache-2.0
"""The robot's knowledge base and the facts that the fleet shares: reads own ones, takes those of others."""

import contextlib
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Sequence, Set, Tuple

import rospy
from merlin_msgs.msg import KnowledgeChanges

from merlin_planning.knowledge_client import ADD, REMOVE, KnowledgeClient, KnowledgeError, Update, fact
from merlin_ros.service_proxy import ServiceError

OBJECTS = ""  # stands for a predicate: each object with its type
LOOK = 2.0  # s between two looks whether the knowledge base is still the same, and attempts after a failure

#: Predicate, its facts (None: they cannot be read), version of the knowledge base.
Know = Callable[[str, Optional[Tuple[str, ...]], int], None]


class SharedKnowledge:
    """Follows a knowledge base's changes, whose versions have no gap: after one, all is read again.

    Its objects are read as the facts of the predicate `OBJECTS`.

    :param knowledge: ours; the original knowledge base does not publish its changes.
    :param own: predicates that this robot writes.
    :param know: gets their facts; in this object's thread.
    :param say: gets sentences for a person.
    """

    def __init__(
        self, knowledge: KnowledgeClient, own: Sequence[str], know: Know, say: Callable[[str], None]
    ) -> None:
        self._knowledge = knowledge
        self._own = frozenset((*own, OBJECTS))
        self._know = know
        self._say = say
        self._changed = threading.Condition()  # guards the fields below
        self._version = 0
        self._read: Set[str] = set()
        self._take: Set[str] = set()
        self._learned: Dict[str, Tuple[str, ...]] = {}
        self._closed = False
        self._connections: List[Any] = []  # this and the next are of the thread alone
        self._refused: Dict[str, str] = {}
        self._subscriber: Optional[rospy.Subscriber] = None
        self._thread = threading.Thread(target=self._work, name="fleet knowledge", daemon=True)

    def start(self) -> None:
        """Begins to follow."""
        self._subscriber = rospy.Subscriber(
            f"{self._knowledge.name}/changes",
            KnowledgeChanges,
            self._receive,
            queue_size=1000,
            tcp_nodelay=True,
        )
        self._thread.start()

    def close(self) -> None:
        """Ends the thread that follows the shared facts."""
        with self._changed:
            self._closed = True
            self._changed.notify()

    def learn(self, predicate: str, facts: Tuple[str, ...]) -> None:
        """These are all facts of a predicate that another robot writes. Returns at once."""
        with self._changed:
            self._learned[predicate] = facts
            self._take.add(predicate)
            self._changed.notify()

    def _receive(self, message: KnowledgeChanges) -> None:
        with self._changed:
            missed = message.cleared or message.version != self._version + 1
            self._version = message.version
            items = (*message.added, *message.removed)
            self._read |= self._own if missed else self._own & {item.attribute_name for item in items}
            if missed:
                self._take |= set(self._learned)
            if self._read or self._take:
                self._changed.notify()

    def _work(self) -> None:
        again: Tuple[Set[str], Set[str]] = ({OBJECTS}, set())  # what failed; an original publishes no changes
        looked_at = time.monotonic()
        while not rospy.is_shutdown():
            with self._changed:
                self._changed.wait_for(lambda: self._read or self._take or self._closed, LOOK)
                if self._closed:
                    return
                read, take, version = self._read, self._take, self._version
                self._read, self._take = set(), set()
                learned = dict(self._learned)
            if time.monotonic() >= looked_at + LOOK:
                read, take = read | again[0], take | again[1]
                again, looked_at = (set(), set()), time.monotonic()
            if self._began_anew():
                read, take = set(self._own), set(learned)
            again[0].update(each for each in read if not self._reported(each, version))
            again[1].update(each for each in take if not self._taken(each, learned[each]))

    def _began_anew(self) -> bool:
        """Whether another process is the knowledge base now, or none."""
        assert self._subscriber is not None
        connections = list(self._subscriber.impl.connections)
        same = connections == self._connections
        self._connections = connections
        return not same

    def _reported(self, predicate: str, version: int) -> bool:
        """Reads and delivers the facts of a predicate; whether they could be read."""
        facts = None
        if self._connections or predicate == OBJECTS:  # else its changes do not come
            with contextlib.suppress(ServiceError):
                facts = tuple(sorted(self._facts(predicate)))
        self._know(predicate, facts, version)
        return facts is not None

    def _facts(self, predicate: str) -> Set[str]:
        if predicate == OBJECTS:
            return {f"{name.lower()} {kind.lower()}" for name, kind in self._knowledge.objects().items()}
        return {
            " ".join(pair.value for pair in item.values) for item in self._knowledge.propositions(predicate)
        }

    def _taken(self, predicate: str, facts: Tuple[str, ...]) -> bool:
        """Makes the facts of a predicate these; whether the knowledge base has answered."""
        try:
            known = self._facts(predicate)
            updates = [
                Update(REMOVE, fact(predicate, *old.split())) for old in sorted(known.difference(facts))
            ]
            updates += [Update(ADD, fact(predicate, *new.split())) for new in sorted(set(facts) - known)]
            self._update(predicate, updates)
        except ServiceError:
            return False
        return True

    def _update(self, predicate: str, updates: List[Update]) -> None:
        try:
            self._knowledge.update(updates)
            self._refused.pop(predicate, None)
            return
        except KnowledgeError:
            pass  # one of them: the others count
        refused = ""
        for update in updates:
            try:
                self._knowledge.update([update])
            except KnowledgeError as error:
                refused = refused or str(error)
        if refused and refused != self._refused.get(predicate):
            self._refused[predicate] = refused
            self._say(f"not all facts of '{predicate}' that the fleet shares are taken: {refused}")
