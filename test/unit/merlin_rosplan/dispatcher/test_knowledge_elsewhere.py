# SPDX-License-Identifier: Apache-2.0
"""What a dispatcher hears of a knowledge base in another process."""

from queue import Queue
from types import SimpleNamespace
from typing import Any, Dict

import pytest
import rospy
from fakes.links import Link
from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs.msg import KnowledgeItem, StatusUpdate

from merlin_rosplan.dispatch.dispatch_environment import KnowledgeChanged
from merlin_rosplan.dispatcher.dispatch_topics import KnowledgeEvents
from merlin_test import LONG


def test_a_dispatch_hears_that_the_knowledge_base_has_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    links: Dict[str, Link] = {}
    owned = []

    def subscribe(topic: str, *args: Any, **named: Any) -> Link:
        return links.setdefault(topic, Link(topic, *args, **named))

    monkeypatch.setattr(rospy, "Subscriber", subscribe)
    heard: Queue[KnowledgeChanged] = Queue()
    component: Any = SimpleNamespace(
        knowledge_base="/kb", subscriber=subscribe, own=lambda made: owned.append(made) or made
    )
    KnowledgeEvents(component, heard.put)
    changes, updates = links["/kb/changes"], links["/kb/status/update"]
    updates.publish(StatusUpdate())
    assert heard.get(timeout=LONG).names is None, "an original says nothing else"
    for _ in range(2):
        changes.begin_anew()
        assert heard.get(timeout=LONG).names is None
    changes.publish(KnowledgeChanges(client=rospy.get_name(), added=[KnowledgeItem(attribute_name="Open")]))
    updates.publish(StatusUpdate())
    changes.publish(KnowledgeChanges(cleared=True))
    assert [heard.get(timeout=LONG).names for _ in range(3)] == [{"open"}, set(), None]
    for made in owned:
        made.shutdown()
