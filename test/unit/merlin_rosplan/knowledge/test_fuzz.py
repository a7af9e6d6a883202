# SPDX-License-Identifier: Apache-2.0
"""Whatever comes in, the answer is a result or a refusal that says why; the state is whole afterwards."""

import contextlib
import io
import random

import genpy
import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from hypothesis import given, settings
from hypothesis import strategies as st
from rosplan_knowledge_msgs.msg import (
    DomainFormula,
    DomainInequality,
    ExprBase,
    ExprComposite,
    KnowledgeItem,
)
from rosplan_knowledge_msgs.srv import (
    GetAttributeServiceResponse,
    KnowledgeQueryService,
    KnowledgeQueryServiceRequest,
    KnowledgeQueryServiceResponse,
    KnowledgeUpdateServiceArray,
)

from merlin_pddl.checks.kairos_check import check_input
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.messages.knowledge_messages import KnowledgeReader, KnowledgeWriter, UpdateReader
from merlin_rosplan.messages.wire_items import (
    QueryRequest,
    QueryResponse,
    StoredItems,
    UpdateArrayRequest,
    bounded,
    refuse_too_many,
)

DOMAIN_TEXT = """(define (domain d) (:requirements :adl :durative-actions :fluents :derived-predicates)
  (:types place - object poi - place robot) (:constants anywhere - place)
  (:predicates (at ?r - robot ?p - place) (checked ?p - poi) (idle) (linked ?a ?b - place)
               (far ?a ?b - place))
  (:functions (battery ?r - robot) (limit))
  (:derived (far ?a ?b - place) (or (not (linked ?a ?b)) (exists (?c - place) (linked ?a ?c))))
  (:action rest :parameters (?r - robot) :precondition (imply (idle) (>= (battery ?r) (- (limit) 1)))
    :effect (and (forall (?p - place) (when (at ?r ?p) (not (at ?r ?p)))) (scale-down (battery ?r) (limit))))
  (:durative-action go :parameters (?r - robot ?a ?b - place) :duration (= ?duration (/ 1 (limit)))
    :condition (and (at start (at ?r ?a)) (over all (not (idle))))
    :effect (and (at start (not (at ?r ?a))) (at end (at ?r ?b)) (decrease (battery ?r) (* #t 2))
                 (when (at start (idle)) (at end (idle))))))"""
PROBLEM_TEXT = """(define (problem p) (:domain d) (:objects a b - poi r - robot)
  (:init (at r a) (not (idle)) (= (limit) 2) (= (battery r) 10.5) (at 5 (idle)) (linked a b))
  (:goal (and (checked a) (not (idle)) (forall (?p - poi) (linked ?p a)) (> (battery r) (* 2 (limit)))))
  (:metric minimize (+ (total-time) (limit))))"""
DOMAIN = parse_domain(DOMAIN_TEXT)
WORDS = sorted(set(DOMAIN_TEXT.replace("(", " ( ").replace(")", " ) ").split()))


def mutate(text, seed):
    """A few words dropped, doubled, swapped or replaced by others."""
    chance = random.Random(seed)
    words = text.replace("(", " ( ").replace(")", " ) ").split()
    for _ in range(chance.randint(1, 3)):
        place = chance.randrange(len(words))
        act = chance.randrange(5)
        if act == 0:
            del words[place]
        elif act == 1:
            words.insert(place, words[place])
        elif act == 2:
            other = chance.randrange(len(words))
            words[place], words[other] = words[other], words[place]
        elif act == 3:
            words[place] = chance.choice(WORDS)
        else:
            words[place:place] = words[place : place + chance.randint(1, 30)]
    return " ".join(words)


def read(reader, *args):
    try:
        return reader(*args)
    except PddlError as error:
        assert error.message and error.line > 0 and error.column > 0, repr(error)
        return None


def test_mutated_domains_and_problems_are_read_or_refused_with_a_place():
    accepted = 0
    for seed in range(1000):
        domain = read(parse_domain, mutate(DOMAIN_TEXT, seed), "d")
        if domain is not None:
            accepted += 1
            read(parse_problem, PROBLEM_TEXT, domain, "p")
        problem = read(parse_problem, mutate(PROBLEM_TEXT, seed), DOMAIN, "p")
        if problem is not None:
            again = parse_problem(write_problem(problem, DOMAIN), DOMAIN)
            assert len(again.goals) == len(problem.goals)
    assert accepted > 10


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet="()?:-;=\n abз\x00.1é\"'<", max_size=200))
def test_any_text_is_refused(text):
    assert read(parse_domain, text, "d") is None


NAMES = ["", "at", "AT", "checked", "idle", "linked", "far", "battery", "limit", "a", "B", "r", "anywhere"]
NAMES += [
    "poi",
    "place",
    "robot",
    "object",
    "ghost",
    "=",
    "x y",
    "(",
    "é",
    "total-cost",
    "(idle)",
    "(or (idle)",
]
NAMES += ["(forall (?p - poi) (linked ?p ?p))", "\x1f"]
NUMBERS = [0.0, 1.0, -2.5, 1e300, -1e-300, float("inf"), float("nan")]


class Sender:
    """Makes messages at random, most of them nonsense, some of them right."""

    def __init__(self, seed):
        self.chance = random.Random(seed)
        self.number = self.chance.randint
        self.pick = self.chance.choice

    def name(self):
        return self.pick(NAMES)

    def values(self):
        return [KeyValue(self.name(), self.name()) for _ in range(self.number(0, 3))]

    def expression(self):
        return ExprComposite([self.token() for _ in range(self.number(0, 5))])

    def token(self):
        kind = self.pick([0, 0, 1, 1, 2, 2, 3, 4])
        function = self.pick([DomainFormula("limit", []), DomainFormula(self.name(), self.values())])
        return ExprBase(kind, self.pick(NUMBERS), function, self.number(0, 5), self.number(0, 3))

    def item(self):
        values = self.pick([self.values(), [KeyValue("", "r"), KeyValue("", "a")], [KeyValue("", "b")], []])
        item = KnowledgeItem(
            knowledge_type=self.pick([0, 1, 1, 1, 2, 2, 3, 4, 5]),
            is_negative=self.pick([False, False, True]),
            instance_type=self.name(),
            instance_name=self.name(),
            attribute_name=self.pick([self.name(), "at", "linked", "checked", "battery", "limit"]),
            values=values,
            function_value=self.pick(NUMBERS),
            assign_op=self.number(0, 6),
            optimization=self.pick(["", "minimize", "Maximize", "best"]),
            expr=self.expression(),
            ineq=DomainInequality(self.number(0, 5), self.expression(), self.expression(), False),
        )
        item.initial_time.secs = self.pick([0, 0, 0, 1, 100])
        return item

    def array(self):
        return [(self.number(0, 6), self.item()) for _ in range(self.pick([1, 1, 1, 2, 4]))]


def everything(store):
    return (
        [(i.type_name, i.name) for i in store._state.instances.all()],
        [fact.text() for fact in store.facts()],
        [(value.text(), value.value) for value in store.values()],
        [(row.at, row.item.text()) for row in store.timed()],
        [goal.text() for goal in store.goals()],
        store.metric,
        store.version,
    )


def check_indexes(store):
    state = store._state
    for table in (state.facts, state.values):
        for key, row in table.rows.items():
            assert row.key == key
            for wildcard in range(1, len(key)):
                pattern = list(key[1:])
                pattern[wildcard - 1] = ""
                assert key in list(table.match(key[0], pattern)) and key in table.mentioning(key[wildcard])
        assert sum(map(len, table._names().values())) == len(table.rows)
    assert sum(map(len, state.instances._made()[0].values())) == len(state.instances.rows)


def over_the_wire(array):
    request = UpdateArrayRequest([kind for kind, _ in array], [message for _, message in array])
    buffer = io.BytesIO()
    request.serialize(buffer)
    received = UpdateArrayRequest().deserialize(buffer.getvalue())
    for (_, sent), found in zip(array, received.knowledge):
        for name in ("knowledge_type", "is_negative", "instance_type", "attribute_name", "initial_time"):
            assert getattr(sent, name) == getattr(found, name)
        assert [(v.key, v.value) for v in sent.values] == [(v.key, v.value) for v in found.values]
        assert len(sent.expr.tokens) == len(found.expr.tokens)
        assert len(sent.ineq.LHS.tokens) == len(found.ineq.LHS.tokens)
    assert len(received.knowledge) == len(array)
    return list(zip(received.update_type, received.knowledge))


@pytest.mark.parametrize("seed", range(20))
def test_what_is_not_true_goes_back_as_it_came(seed):
    items = [Sender(seed).item() for _ in range(5)]
    buffer = io.BytesIO()
    KnowledgeQueryServiceRequest(items).serialize(buffer)
    received = QueryRequest().deserialize(buffer.getvalue()).knowledge
    results = [number % 2 == 0 for number in range(5)]
    answer = io.BytesIO()
    QueryResponse(results, received[1::2]).serialize(answer)
    read = KnowledgeQueryServiceResponse().deserialize(answer.getvalue())
    assert repr(read) == repr(KnowledgeQueryServiceResponse(False, results, items[1::2]))  # nan is not nan


@pytest.mark.parametrize(
    "service, request_class, args",
    [
        (KnowledgeUpdateServiceArray, UpdateArrayRequest, ([0] * 9,)),
        (KnowledgeQueryService, QueryRequest, ()),
    ],
)
def test_of_a_request_with_too_many_items_only_the_number_is_read(service, request_class, args):
    buffer = io.BytesIO()
    request_class(*args, [KnowledgeItem()] * 9).serialize(buffer)
    request = bounded(service, request_class, 8)._request_class().deserialize(buffer.getvalue())
    assert (request.too_many, request.knowledge) == (9, [])
    with pytest.raises(rospy.ServiceException, match="9 items, more than the 8"):
        refuse_too_many(request)
    for enough in (9, 0):
        request = bounded(service, request_class, enough)._request_class().deserialize(buffer.getvalue())
        refuse_too_many(request)
        assert len(request.knowledge) == 9


def test_bytes_that_end_too_early_are_no_request():
    buffer = io.BytesIO()
    UpdateArrayRequest([0, 1], [Sender(3).item(), KnowledgeItem(attribute_name="a" * 9)]).serialize(buffer)
    for length in range(0, len(buffer.getvalue()) - 1, 7):
        with pytest.raises(genpy.DeserializationError):
            UpdateArrayRequest().deserialize(buffer.getvalue()[:length])


def send(store, updates, array):
    before = everything(store)
    try:
        with store.transaction() as transaction:
            for kind, message in array:
                updates.apply(transaction, kind, message)
    except UpdateRefused as error:
        assert str(error)
        assert everything(store) == before
        return False
    return True


@pytest.mark.parametrize("strict", [True, False])
def test_updates_count_wholly_or_not_at_all(strict):
    accepted = sum(bombard(seed, strict) for seed in range(250))
    assert 250 < accepted < 2500  # of 10 arrays in each run


def bombard(seed, strict):
    sender = Sender(seed)
    now = [0]
    store = KnowledgeStore(DOMAIN, strict, clock=lambda: now[0])
    store.load_problem(parse_problem(PROBLEM_TEXT, DOMAIN))
    updates = UpdateReader(DOMAIN, store.objects, strict)
    reader, writer = KnowledgeReader(DOMAIN), KnowledgeWriter(DOMAIN)
    accepted = 0
    for _ in range(10):
        now[0] += 10_000_000_000
        store.fire_due()
        array = over_the_wire(sender.array())
        accepted += send(store, updates, array)
        for _, message in array:
            with contextlib.suppress(UpdateRefused):
                store.query([reader.query(message, store.objects)])
    check_indexes(store)
    buffer = io.BytesIO()
    StoredItems(store.facts(), writer).serialize(buffer)
    found = GetAttributeServiceResponse().deserialize(buffer.getvalue()).attributes
    assert found == [writer.item(row) for row in store.facts()]
    for row in (*store.facts(), *store.values()):
        writer.item(row)
    goals = [writer.goal(goal) for goal in store.goals()]
    metric = writer.metric(store.metric)
    if strict:
        for goal, message in zip(store.goals(), goals):
            assert reader.goal(message, store.objects).key == goal.key
        assert store.metric is None or reader.metric(metric) == store.metric
        text = write_problem(store.snapshot()[1], DOMAIN)
        parse_problem(text, DOMAIN)
        assert check_input(DOMAIN_TEXT, text, "domain", "problem") is None, text
    return accepted


def test_effects_count_wholly_or_not_at_all():
    for seed in range(400):
        sender = Sender(seed)
        store = KnowledgeStore(DOMAIN, clock=lambda: 0)
        store.load_problem(parse_problem(PROBLEM_TEXT, DOMAIN))
        for _ in range(8):
            operator = sender.pick(["go", "go", "rest", "GO", "fly", ""])
            parameters = {key: sender.pick(["r", "a", "b", "B", sender.name()]) for key in "rab"}
            if sender.number(0, 9) == 0:
                parameters.pop("a")
            phase = sender.pick(["start", "end", "rollback", "interrupt"])
            token = sender.pick(["", "one", "two"])
            more = (parameters,) if phase in ("start", "end") else ()
            if phase == "start":
                literals = [
                    "(at r b)",
                    "(not (at r a))",
                    "(at r nowhere)",
                    "(at r",
                    "at",
                    "(= 1 1)",
                    sender.name(),
                ]
                more += ("/n", [sender.pick(literals)][: sender.number(0, 1)], [sender.pick(literals)])
            before = everything(store)
            try:
                with store.transaction() as transaction:
                    getattr(Executions(transaction), phase)(token, operator, *more)
            except UpdateRefused as error:
                assert str(error)
                assert everything(store) == before
        check_indexes(store)
