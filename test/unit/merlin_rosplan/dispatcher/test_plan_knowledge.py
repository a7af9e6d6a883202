# SPDX-License-Identifier: Apache-2.0
"""What parser and dispatcher ask of a knowledge base in another process."""

from types import SimpleNamespace
from typing import Any, Dict, List

import pytest
import rospy
from merlin_msgs.msg import OpenExecution
from rosplan_knowledge_msgs.msg import DomainOperator, KnowledgeItem

from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain
from merlin_planning.knowledge_client import fact, function_value
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_rosplan.dispatch.dispatch_environment import PlanKnowledgeError
from merlin_rosplan.dispatch.operator_model import PlanTerm
from merlin_rosplan.dispatch.plan_graph import TimedLiteral, TimedValue
from merlin_rosplan.dispatcher import plan_knowledge
from merlin_rosplan.dispatcher.plan_knowledge import PlanKnowledge
from merlin_rosplan.messages.domain_messages import operator_message

OPERATORS = parse_domain(
    """(define (domain d) (:types poi) (:predicates (seen ?p - poi) (dark))
    (:constraints (forall (?p - poi) (at-most-once (seen ?p))))
    (:action look :parameters (?p - poi) :effect (seen ?p))
    (:action find :parameters (?p - poi) :precondition (or (dark) (seen ?p)) :effect (not (seen ?p))))"""
)


class Remote:
    """A knowledge base in another process; `asked` is what travels."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain
        self.name = "/kb"
        self.stays = False
        self.asked: List[str] = []
        self.timed: List[KnowledgeItem] = []
        self.values: Dict[str, List[KnowledgeItem]] = {}
        self.there = True
        self.lists: Any = True  # whether its executions are offered; an error: the master is silent

    def operator(self, name: str) -> DomainOperator:
        self.asked.append(name)
        self.stays = True
        return operator_message(self.domain, self.domain.operators[name])

    def file(self) -> Domain:
        self.asked.append("file")
        return self.domain

    def wait(self, timeout: float) -> bool:
        return self.there

    def offered(self) -> bool:
        if isinstance(self.lists, Exception):
            raise self.lists
        return bool(self.lists)

    def functions(self, name: str) -> List[KnowledgeItem]:
        return self.values[name]


@pytest.fixture
def remote(monkeypatch: pytest.MonkeyPatch) -> Remote:
    made = Remote(OPERATORS)
    monkeypatch.setattr(plan_knowledge, "KnowledgeClient", lambda *_: made)
    monkeypatch.setattr(plan_knowledge, "DomainFile", lambda _: SimpleNamespace(domain=made.file))

    class Proxy:
        offered = made.offered

        def __init__(self, *_: Any) -> None:
            pass

        def available(self) -> bool:
            return made.lists is True

        def __call__(self, *_: Any, **__: Any) -> Any:
            return SimpleNamespace(attributes=made.timed, executions=[OpenExecution(token="3/7/x")])

    monkeypatch.setattr(plan_knowledge, "DirectServiceProxy", Proxy)
    return made


def test_operators_are_asked_for_once_as_long_as_the_knowledge_base_lives(remote: Remote) -> None:
    knowledge = PlanKnowledge("/kb")
    for _ in range(3):
        for name in ("look", "find"):
            model = knowledge.operator(name)
    assert remote.asked == ["look", "file", "find"]
    assert [str(entry) for entry in model.at_start.expressions] == ["(or (dark) (seen ?p))"]
    assert model.constraints == ({("seen", "?p")},)


def test_another_knowledge_base_may_have_another_domain(remote: Remote) -> None:
    knowledge = PlanKnowledge("/kb")
    assert knowledge.operator("look").start_effects.add == (PlanTerm("seen", ("?p",)),)
    remote.stays = False
    remote.domain = parse_domain(
        "(define (domain d) (:predicates (done)) (:action look :parameters () :effect (done)))"
    )
    assert knowledge.operator("look").start_effects.add == (PlanTerm("done"),)
    assert remote.asked == ["look", "file", "look", "file"]


@pytest.mark.parametrize("lists", [False, ServiceUnavailable("the master does not answer")])
def test_a_silence_does_not_say_that_no_executions_are_listed(remote: Remote, lists: Any) -> None:
    knowledge = PlanKnowledge("/kb")
    remote.there, remote.lists = False, lists
    with pytest.raises(PlanKnowledgeError):
        knowledge.held(3)
    remote.there = remote.lists = True
    assert knowledge.held(3) == {7: frozenset()}


def test_what_followed_a_knowledge_base_without_executions_may_list_them(remote: Remote) -> None:
    knowledge = PlanKnowledge("/kb")
    knowledge.operator("look")
    remote.lists = False
    assert knowledge.held(3) is None
    remote.lists = True
    assert knowledge.held(3) is None  # the same one
    remote.stays = False
    knowledge.operator("look")
    assert knowledge.held(3) == {7: frozenset()}


def test_timed_increases_are_the_values_that_they_give(
    remote: Remote, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(100))
    increase = function_value("battery", ["R1"], 5.0)
    increase.assign_op = KnowledgeItem.AP_INCREASE
    for second, item in ((104, increase), (103, fact("idle", negative=True)), (102, fact("idle"))):
        item.initial_time = rospy.Time(second)
        remote.timed.append(item)
    remote.values = {"battery": [function_value("battery", ["r1"], 20.0)]}
    assert PlanKnowledge("/kb").timed() == [
        TimedLiteral(2.0, PlanTerm("idle")),
        TimedLiteral(3.0, PlanTerm("idle"), negative=True),
        TimedValue(4.0, PlanTerm("battery", ("R1",)), 25.0),
    ]
