# SPDX-License-Identifier: Apache-2.0
"""A client hears what others change in its knowledge base, and that this has begun anew."""

from queue import Queue
from typing import Any, List

import pytest
import rospy
from fakes.links import Link
from merlin_msgs.msg import KnowledgeChanges

from merlin_planning.foreign_changes import ForeignChanges
from merlin_test import LONG


def test_changes_of_others_are_heard_and_one_that_has_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    links: List[Link] = []
    monkeypatch.setattr(
        rospy, "Subscriber", lambda *args, **named: links.append(Link(*args, **named)) or links[0]
    )
    heard: Queue[Any] = Queue()
    changes = ForeignChanges("/kb", heard.put)
    (link,) = links
    assert link.topic == "/kb/changes" and not changes.connected
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
