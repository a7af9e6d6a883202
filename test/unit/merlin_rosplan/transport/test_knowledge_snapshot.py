# SPDX-License-Identifier: Apache-2.0
"""The whole knowledge base of another process, which may be started again."""

from types import SimpleNamespace
from typing import Any, Callable, Dict, List

import pytest
import rospy
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_rosplan.messages import knowledge_snapshot
from merlin_rosplan.messages.knowledge_snapshot import KnowledgeSnapshots


class Remote:
    """A knowledge base in another process: its types, each with its objects."""

    def __init__(self, **objects: List[str]) -> None:
        self.started_anew(**objects)
        self.constants: List[str] = []  # rooms
        self.asked: List[str] = []
        self.on_instances: Callable[[], object] = lambda: None  # called behind each answer

    def started_anew(self, **objects: List[str]) -> None:
        self.process = object()
        self.objects = objects

    def answer(self, suffix: str, *args: Any) -> Any:
        self.asked.append(suffix)
        if suffix == "state/instances":
            kind, constants = args[:2]
            listed = [*self.objects.get(kind, []), *(self.constants if constants and kind == "room" else [])]
            self.on_instances()
            return SimpleNamespace(instances=listed)
        answers: Dict[str, Dict[str, Any]] = {
            "domain/name": {"domain_name": "d"},
            "domain/types": {"types": list(self.objects), "super_types": [""] * len(self.objects)},
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


@pytest.mark.parametrize("at", [1, 2])
@pytest.mark.parametrize("comes", [True, False])
def test_an_object_that_comes_or_goes_while_the_domain_is_read_changes_no_constants(
    remote: Remote, at: int, comes: bool
) -> None:
    def change() -> None:
        if remote.asked.count("state/instances") == at:
            remote.objects["room"] = ["hall", "kitchen"] if comes else []

    remote.constants = ["lift"]
    remote.on_instances = change
    domain, problem = KnowledgeSnapshots("/kb").snapshot()
    assert domain.constants == {"lift": ("room",)}
    assert list(problem.objects) == remote.objects["room"]


def test_a_constant_may_have_the_name_of_an_object(remote: Remote) -> None:
    remote.constants = ["hall"]
    assert KnowledgeSnapshots("/kb").domain().constants == {"hall": ("room",)}
