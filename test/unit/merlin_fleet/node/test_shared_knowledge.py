# SPDX-License-Identifier: Apache-2.0
"""The knowledge base of a robot and the facts that its fleet shares."""

import threading
from types import SimpleNamespace
from typing import Any, Dict, Iterator, List, Sequence, Set, Tuple

import pytest
import rospy
from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin_fleet.node import shared_knowledge
from merlin_fleet.node.shared_knowledge import OBJECTS, SharedKnowledge
from merlin_planning.knowledge_client import ADD, KnowledgeError, Update, fact, instance
from merlin_ros.service_proxy import ServiceError
from merlin_test import LONG


class Lab:
    """A knowledge base in memory, and its messages."""

    name = "/kb"

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.changed = threading.Condition()  # guards the fields below
        self.state: Dict[str, Set[str]] = {"door_open": {"ward"}, "delivered": {"box_1 ward"}}
        self.known: List[Tuple[Any, ...]] = []
        self.objects_known: List[Tuple[Any, ...]] = []
        self.kinds = {"Ward": "room"}
        self.said: List[str] = []
        self.updates = 0
        self.silent = False
        self.version = 5
        monkeypatch.setattr(rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(shared_knowledge, "LOOK", 0.05)
        self.connections: List[Any] = []
        self.shared = SharedKnowledge(self, ["door_open"], self._know, self.said.append)
        self.shared.start()

    def _subscribe(self, topic: str, _: Any, receive: Any, **__: Any) -> Any:
        assert topic == "/kb/changes"
        self.receive = receive
        return SimpleNamespace(impl=SimpleNamespace(connections=self.connections))

    def _know(self, *known: Any) -> None:
        with self.changed:
            (self.objects_known if known[0] == OBJECTS else self.known).append(known)
            self.changed.notify_all()

    def until(self, holds: Any) -> None:
        with self.changed:
            assert self.changed.wait_for(holds, LONG), vars(self)

    def change(self, predicate: str, *facts: str, step: int = 1, reported: bool = True) -> None:
        """Something changes, and is published in `changes`."""
        with self.changed:
            self.state[predicate] = set(facts)
            self.version += step
        if reported:
            self.receive(KnowledgeChanges(version=self.version, added=[fact(predicate, "x")]))

    # --- as a knowledge base has it

    def objects(self) -> Dict[str, str]:
        with self.changed:
            if self.silent:
                raise ServiceError("it does not answer")
            return dict(self.kinds)

    def propositions(self, predicate: str = "") -> List[KnowledgeItem]:
        with self.changed:
            if self.silent:
                raise ServiceError("it does not answer")
            return [fact(predicate, *text.split()) for text in self.state[predicate]]

    def update(self, updates: Sequence[Update]) -> None:
        with self.changed:
            items = [(step.kind, " ".join(pair.value for pair in step.item.values)) for step in updates]
            if any("attic" in text for _, text in items):
                raise KnowledgeError("there is no object 'attic'")
            for kind, text in items:
                state = self.state[updates[0].item.attribute_name]
                state.add(text) if kind == ADD else state.discard(text)
            self.updates += bool(items)
            self.changed.notify_all()


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    found = Lab(monkeypatch)
    try:
        yield found
    finally:
        found.shared.close()


def connect(lab: Lab) -> None:
    lab.connections[:] = [object()]
    lab.until(lambda: lab.known and lab.known[-1][1] is not None)


def test_own_facts_are_reported_with_each_change(lab: Lab) -> None:
    connect(lab)
    assert lab.known[-1][:2] == ("door_open", ("ward",))
    lab.change("door_open", "ward", "lab")
    lab.until(lambda: lab.known[-1] == ("door_open", ("lab", "ward"), 6))
    lab.change("delivered")
    lab.change("door_open")
    lab.until(lambda: lab.known[-1] == ("door_open", (), 8))
    assert {known[0] for known in lab.known} == {"door_open"}


def test_after_a_gap_all_is_read_again(lab: Lab) -> None:
    connect(lab)
    lab.change("delivered")  # whatever was missed before the first one is read, too
    lab.until(lambda: lab.known[-1] == ("door_open", ("ward",), 6))
    lab.change("door_open", "vault", reported=False)
    lab.change("delivered")
    lab.until(lambda: lab.known[-1] == ("door_open", ("vault",), 8))


def test_a_knowledge_base_that_is_gone_or_silent_is_reported_and_tried_again(lab: Lab) -> None:
    connect(lab)
    lab.connections[:] = []
    lab.until(lambda: lab.known[-1][1] is None)
    lab.silent = True
    lab.connections[:] = [object()]
    lab.silent = False
    lab.until(lambda: lab.known[-1][1] == ("ward",))


def test_facts_of_others_are_taken_as_they_are(lab: Lab) -> None:
    lab.shared.learn("delivered", ("box_2 ward", "box_3 lab"))
    lab.until(lambda: lab.state["delivered"] == {"box_2 ward", "box_3 lab"})
    assert lab.updates == 1
    connect(lab)
    lab.change("delivered", reported=False)  # it has begun anew with its file
    lab.connections[:] = [object()]
    lab.until(lambda: lab.state["delivered"] == {"box_2 ward", "box_3 lab"})


def test_facts_that_cannot_be_taken_are_named_once_and_the_others_count(lab: Lab) -> None:
    lab.shared.learn("delivered", ("box_1 attic", "box_2 ward"))
    lab.until(lambda: lab.state["delivered"] == {"box_2 ward"})
    lab.shared.learn("delivered", ("box_1 attic", "box_3 ward"))
    lab.until(lambda: lab.state["delivered"] == {"box_3 ward"})
    lab.shared.learn("delivered", ("box_4 ward",))
    lab.until(lambda: lab.state["delivered"] == {"box_4 ward"})
    assert lab.said == [
        "not all facts of 'delivered' that the fleet shares are taken: there is no object 'attic'"
    ]


def test_a_silent_knowledge_base_gets_them_later(lab: Lab) -> None:
    with lab.changed:
        lab.silent = True
    lab.shared.learn("delivered", ("box_2 ward",))
    with lab.changed:
        lab.changed.wait(0.2)
        lab.silent = False
    lab.until(lambda: lab.state["delivered"] == {"box_2 ward"})


def test_objects_are_read_at_the_begin_and_when_one_comes(lab: Lab) -> None:
    """An original knowledge base publishes no changes: there they are read once."""
    lab.until(lambda: any(known[1] == ("ward room",) for known in lab.objects_known))
    with lab.changed:
        lab.kinds["cup_1"] = "cup"
    lab.connections.append(object())
    lab.receive(KnowledgeChanges(version=6, added=[instance("cup", "cup_1")]))
    lab.until(lambda: lab.objects_known[-1][1] == ("cup_1 cup", "ward room"))
