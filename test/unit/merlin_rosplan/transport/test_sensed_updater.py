# SPDX-License-Identifier: Apache-2.0
"""What was sensed reaches the knowledge base, whatever else it refuses and however long it is away."""

import threading

import pytest
import rospy

from merlin_planning.knowledge_client import KnowledgeError
from merlin_planning.knowledge_text import to_pddl
from merlin_ros.service_proxy import ServiceError
from merlin_rosplan.transport import sensed_updater
from merlin_rosplan.transport.sensed_updater import SensedUpdater
from merlin_test import LONG


class Knowledge:
    """Takes what it knows the objects of, all of an update or nothing."""

    def __init__(self):
        self.changed = threading.Condition()
        self.unknown = {"moon"}
        self.gone = False
        self.facts = {}
        self.calls = 0

    def update(self, updates):
        with self.changed:
            self.calls += 1
            self.changed.notify_all()
            if self.gone:
                raise ServiceError("gone")
            if any(value.value in self.unknown for update in updates for value in update.item.values):
                raise KnowledgeError("unknown object")
            for update in updates:
                negative, update.item.is_negative = update.item.is_negative, False
                self.facts[to_pddl(update.item)] = not negative

    def wait(self, holds):
        with self.changed:
            assert self.changed.wait_for(holds, LONG), self.facts


@pytest.fixture
def knowledge():
    return Knowledge()


@pytest.fixture
def teller(knowledge, monkeypatch):
    monkeypatch.setattr(sensed_updater, "RETRY", 0.02)
    monkeypatch.setattr(rospy, "logerr_throttle_identical", lambda period, text: None)
    made = SensedUpdater(knowledge, 0.001, "sensing")
    yield made
    made.close()
    made._thread.join(LONG)
    assert not made._thread.is_alive()


def test_what_is_refused_does_not_keep_the_rest(teller, knowledge):
    teller.sense({("at", ("ann", "moon")): True, ("at", ("ann", "den")): False, ("powered", ()): True})
    knowledge.wait(lambda: knowledge.facts == {"(at ann den)": False, "(powered)": True})
    teller.sense({("powered", ()): False})
    knowledge.wait(lambda: not knowledge.facts["(powered)"])


def test_what_was_refused_is_reported_when_its_object_appears(teller, knowledge, monkeypatch):
    monkeypatch.setattr(sensed_updater, "LONGEST_RETRY", 3600.0)
    teller.sense({("at", ("ann", "moon")): True})
    knowledge.wait(lambda: knowledge.calls > 5)
    with knowledge.changed:
        knowledge.unknown.clear()
    teller.objects_appeared()
    knowledge.wait(lambda: knowledge.facts == {"(at ann moon)": True})


def test_what_was_refused_counts_as_it_was_sensed_last(teller, knowledge):
    teller.sense({("at", ("ann", "moon")): True})
    knowledge.wait(lambda: knowledge.calls > 1)
    teller.sense({("at", ("ann", "moon")): False})
    with knowledge.changed:
        knowledge.unknown.clear()
    knowledge.wait(lambda: knowledge.facts == {"(at ann moon)": False})


def test_a_knowledge_base_that_was_away_gets_everything(teller, knowledge):
    knowledge.gone = True
    teller.sense({("powered", ()): True, ("lit", ("ann",)): True})
    knowledge.wait(lambda: knowledge.calls > 8)
    knowledge.gone = False
    knowledge.wait(lambda: knowledge.facts == {"(powered)": True, "(lit ann)": True})


@pytest.mark.parametrize("value", [10**400, "no number"])
def test_what_no_message_can_carry_does_not_keep_the_rest(teller, knowledge, value):
    teller.sense({("battery", ()): value, ("powered", ()): True})
    knowledge.wait(lambda: knowledge.facts == {"(powered)": True})
    teller.sense({("powered", ()): False})
    knowledge.wait(lambda: knowledge.facts == {"(powered)": False})
