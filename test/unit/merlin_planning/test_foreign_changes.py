# SPDX-License-Identifier: Apache-2.0
"""A client hears what others change in its knowledge base, and that this has begun anew."""

import socket
from queue import Queue
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
import rospy
from merlin_msgs.msg import KnowledgeChanges

from merlin_planning.foreign_changes import ForeignChanges
from merlin_test import LONG


class Link:
    """The subscriber of a test."""

    def __init__(self, topic: str, _: type, callback: Callable[[Any], None], **__: Any) -> None:
        assert topic == "/kb/changes"
        self.publish = callback
        self.impl = SimpleNamespace(connections=[])
        self._ends: List[socket.socket] = []

    def begin_anew(self) -> None:
        """Another process publishes from now on."""
        for end in self._ends:
            end.close()
        self._ends = list(socket.socketpair())
        self.impl.connections = [SimpleNamespace(socket=self._ends[0])]

    def get_num_connections(self) -> int:
        return len(self.impl.connections)

    def unregister(self) -> None:
        for end in self._ends:
            end.close()


def test_changes_of_others_are_heard_and_one_that_has_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    links: List[Link] = []
    monkeypatch.setattr(
        rospy, "Subscriber", lambda *args, **named: links.append(Link(*args, **named)) or links[0]
    )
    heard: Queue[Any] = Queue()
    changes = ForeignChanges("/kb", heard.put)
    (link,) = links
    assert not changes.connected
    for _ in range(2):
        link.begin_anew()
        assert heard.get(timeout=LONG) is None and changes.connected
    link.publish(KnowledgeChanges(client=rospy.get_name(), cleared=True))
    other = KnowledgeChanges(client="/other", version=7)
    link.publish(other)
    assert heard.get(timeout=LONG) is other
    link.publish(KnowledgeChanges(client="/other", cleared=True))
    assert heard.get(timeout=LONG) is None
    changes.shutdown()
    assert heard.empty()
