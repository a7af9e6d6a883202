# SPDX-License-Identifier: Apache-2.0
"""The whole knowledge base of another process, which may be started again."""

from types import SimpleNamespace
from typing import Any, Dict, List

import pytest
import rospy
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_rosplan.messages import knowledge_snapshot
from merlin_rosplan.messages.knowledge_snapshot import KnowledgeSnapshots


class Remote:
    """A knowledge base in another process: its types, each with its objects."""

    def __init__(self, **objects: List[str]) -> None:
        self.started_anew(**objects)
        self.asked: List[str] = []

    def started_anew(self, **objects: List[str]) -> None:
        self.process = object()
        self.objects = objects

    def answer(self, suffix: str, *args: Any) -> Any:
        self.asked.append(suffix)
        answers: Dict[str, Dict[str, Any]] = {
            "domain/name": {"domain_name": "d"},
            "domain/types": {"types": list(self.objects), "super_types": [""] * len(self.objects)},
            "state/instances": {"instances": self.objects.get(args[0], []) if args else []},
            "state/metric": {"metric": KnowledgeItem()},
        }
        return SimpleNamespace(**answers.get(suffix, {"items": [], "attributes": []}))


@pytest.fixture
def remote(monkeypatch: pytest.MonkeyPatch) -> Remote:
    made = Remote(room=["hall"])

    class Proxy:
        def __init__(self, name: str, *_: Any, **__: Any) -> None:
            self._suffix = name[len("/kb/") :]
            self._process: Any = None

        @property
        def connected(self) -> bool:
            return self._process is made.process

        def __call__(self, *args: Any) -> Any:
            self._process = made.process
            return made.answer(self._suffix, *args)

    monkeypatch.setattr(knowledge_snapshot, "ServiceProxy", Proxy)
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(1))
    return made


def test_a_knowledge_base_that_was_started_anew_may_have_another_domain_of_the_same_name(
    remote: Remote,
) -> None:
    snapshots = KnowledgeSnapshots("/kb")
    assert snapshots.snapshot()[1].objects == {"hall": ("room",)}
    remote.started_anew(room=["hall"], cup=["mug"])
    assert snapshots.snapshot()[1].objects == {"hall": ("room",), "mug": ("cup",)}


def test_the_domain_is_read_once_as_long_as_the_knowledge_base_lives(remote: Remote) -> None:
    snapshots = KnowledgeSnapshots("/kb")
    for _ in range(3):
        snapshots.snapshot()
    assert remote.asked.count("domain/types") == 1
