# SPDX-License-Identifier: Apache-2.0
"""Arguments that are named by the declared keys count by their names, whatever their order."""

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, ExprComposite, KnowledgeItem
from rosplan_knowledge_msgs.srv import KnowledgeUpdateServiceRequest as Request

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Instance
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader, KnowledgeWriter, UpdateReader

DOMAIN = parse_domain(
    """(define (domain d) (:types room)
    (:predicates (door ?from ?to - room)) (:functions (way ?from ?to - room))
    (:action pass :parameters (?from ?to - room) :precondition (door ?from ?to) :effect (door ?to ?from)))"""
)
FACT, FUNCTION, INEQUALITY = KnowledgeItem.FACT, KnowledgeItem.FUNCTION, KnowledgeItem.INEQUALITY
EXCHANGED = [("to", "b"), ("from", "a")]


class Client:
    def __init__(self, strict=True):
        self.store = KnowledgeStore(DOMAIN, strict)
        self.updates = UpdateReader(DOMAIN, self.store.objects, strict)
        self.reader, self.writer = KnowledgeReader(DOMAIN, strict), KnowledgeWriter(DOMAIN)
        with self.store.transaction() as change:
            for name in "ab":
                change.add(Instance("room", name))

    def send(self, kind, item):
        with self.store.transaction() as change:
            self.updates.apply(change, kind, item)

    def holds(self, item):
        return self.store.query([self.reader.query(item, self.store.objects)]) == [True]


@pytest.fixture
def client():
    return Client()


def pairs(values):
    return [KeyValue(*pair) for pair in values]


def item(kind, values, name="", **more):
    name = name or ("door" if kind == FACT else "way")
    return KnowledgeItem(knowledge_type=kind, attribute_name=name, values=pairs(values), **more)


def way(values):
    """The length of a way, as a token of an expression."""
    return ExprBase(expr_type=ExprBase.FUNCTION, function=DomainFormula("way", pairs(values)))


def longer_than(values, constant):
    left, right = (
        ExprComposite([way(values)]),
        ExprComposite([ExprBase(constant=constant)]),
    )
    return KnowledgeItem(
        knowledge_type=INEQUALITY, ineq=DomainInequality(DomainInequality.GREATER, left, right, False)
    )


@pytest.mark.parametrize(
    "values, stored",
    [
        ([("from", "a"), ("to", "b")], "(door a b)"),
        (EXCHANGED, "(door a b)"),
        ([("TO", "b"), ("?from", "a")], "(door a b)"),
        ([("p0", "b"), ("p1", "a")], "(door b a)"),
        ([("", "b"), ("", "a")], "(door b a)"),
        ([("x", "b"), ("x", "a")], "(door b a)"),
    ],
)
def test_facts_and_goals(client, values, stored):
    fact = item(FACT, values)
    client.send(Request.ADD_KNOWLEDGE, fact)
    client.send(Request.ADD_GOAL, fact)
    assert [row.text() for row in client.store.facts()] == [stored]
    assert [goal.text() for goal in client.store.goals()] == [stored]
    assert client.holds(fact)
    answer = client.writer.item(client.store.facts()[0]).values
    assert [pair.key for pair in answer] == ["from", "to"]
    client.send(Request.REMOVE_KNOWLEDGE, fact)
    client.send(Request.REMOVE_GOAL, fact)
    assert client.store.facts() == [] and client.store.goals() == [] and not client.holds(fact)


def test_the_other_direction_is_another_fact(client):
    client.send(Request.ADD_KNOWLEDGE, item(FACT, EXCHANGED))
    opposite = item(FACT, [("from", "b"), ("to", "a")])
    assert not client.holds(opposite)
    client.send(Request.REMOVE_KNOWLEDGE, opposite)
    assert len(client.store.facts()) == 1
    client.send(Request.REMOVE_KNOWLEDGE, item(FACT, [("to", ""), ("from", "a")]))  # from a, whereto ever
    assert client.store.facts() == []


def test_functions_comparisons_metrics_and_what_comes_later(client):
    client.send(Request.ADD_KNOWLEDGE, item(FUNCTION, EXCHANGED, function_value=4.0))
    assert [(row.text(), row.value) for row in client.store.values()] == [("(way a b)", 4.0)]
    assert client.holds(item(FUNCTION, EXCHANGED)) and client.holds(longer_than(EXCHANGED, 3.0))
    client.send(Request.ADD_GOAL, longer_than(EXCHANGED, 3.0))
    assert [goal.text() for goal in client.store.goals()] == ["(> (way a b) 3)"]
    metric = KnowledgeItem(
        knowledge_type=KnowledgeItem.EXPRESSION, optimization="minimize", expr=ExprComposite([way(EXCHANGED)])
    )
    client.send(Request.ADD_METRIC, metric)
    assert client.store.metric.value.args == ("a", "b")
    later = item(FACT, EXCHANGED)
    later.initial_time.secs = 100
    client.send(Request.ADD_KNOWLEDGE, later)
    assert [row.item.text() for row in client.store.timed()] == ["(door a b)"]


@pytest.mark.parametrize(
    "values",
    [
        [("to", "b"), ("x", "a")],
        [("from", "a"), ("", "b")],
        [("to", "b"), ("to", "a")],
        [("from", "a"), ("to", "b"), ("via", "a")],
    ],
)
def test_keys_of_which_only_some_are_declared_are_refused(client, values):
    reason = "the keys of '(door|way)' are .*, declared are 'from', 'to'"
    for kind, sent in (
        (Request.ADD_KNOWLEDGE, item(FACT, values)),
        (Request.REMOVE_KNOWLEDGE, item(FACT, values)),
        (Request.ADD_GOAL, item(FACT, values)),
        (Request.ADD_KNOWLEDGE, item(FUNCTION, values)),
        (Request.ADD_GOAL, longer_than(values, 3.0)),
    ):
        with pytest.raises(UpdateRefused, match=reason):
            client.send(kind, sent)
    with pytest.raises(UpdateRefused, match=reason):
        client.holds(item(FACT, values))
    assert client.store.facts() == client.store.values() == client.store.goals() == []


def test_a_store_that_is_not_strict_goes_by_the_order_as_rosplan_does():
    client = Client(strict=False)
    for values in (EXCHANGED, [("to", "b"), ("x", "b")]):
        client.send(Request.ADD_KNOWLEDGE, item(FACT, values))
    assert [row.text() for row in client.store.facts()] == ["(door b a)", "(door b b)"]
