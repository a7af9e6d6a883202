# SPDX-License-Identifier: Apache-2.0
"""Goals of clients that hold leases on them: what goes with a client, and what stays for another one."""

from queue import Queue
from typing import List

import pytest
import rospy
from fakes.topics import Topics
from merlin_msgs.msg import Lease

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import Atom
from merlin_pddl.knowledge import Instance, StoredGoal
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.knowledge_messages import UpdateReader
from merlin_rosplan.nodes.goal_leases import GoalLeases
from merlin_test import LONG

DOMAIN = parse_domain("(define (domain d) (:types place) (:predicates (checked ?p - place)))")


def test_a_goal_stays_that_the_next_life_of_its_client_writes_in_other_letters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    topics, removed = Topics(monkeypatch), Queue()
    monkeypatch.setattr(rospy, "logwarn", lambda *_: None)
    store = KnowledgeStore(DOMAIN)
    places = ["kitchen", "hall"]
    with store.transaction() as change:
        for place in places:
            change.add(Instance("place", place))
            change.add_goal(StoredGoal(Atom("checked", (place,))))
    store.listen(lambda change: removed.put([goal.text() for goal in change.goals_removed]))
    leases = GoalLeases("/kb", store, UpdateReader(DOMAIN, store.objects, True))

    def live(life: str, *held: str) -> None:
        topics.send("/kb/goals/lease", Lease(owner="/executor", life=life, held=held))

    goals: List[str] = ["1 (and (checked kitchen) (checked hall))", "2 (and (checked Kitchen))"]
    live("first", goals[0])
    live("second", goals[1])
    assert removed.get(timeout=LONG) == ["(checked hall)"]
    assert [goal.text() for goal in store.goals()] == ["(checked kitchen)"]
    leases.shutdown()
