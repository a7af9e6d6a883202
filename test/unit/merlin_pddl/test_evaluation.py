# SPDX-License-Identifier: Apache-2.0
import pytest

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance
from merlin_pddl.problem_reader import parse_condition
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore

DOMAIN = parse_domain(
    """(define (domain d) (:types room) (:constants home - room)
    (:predicates (linked ?a ?b - room) (reachable ?a ?b - room) (cut-off ?a - room) (clean ?a - room))
    (:functions (size ?a - room) (limit))
    (:derived (reachable ?a ?b - room)
      (or (linked ?a ?b) (exists (?c - room) (and (linked ?a ?c) (reachable ?c ?b)))))
    (:derived (cut-off ?a - room) (not (reachable home ?a))))"""
)


def make_store(rooms):
    store = KnowledgeStore(DOMAIN)
    with store.transaction() as change:
        for room in rooms:
            change.add(Instance("room", room))
    return store


def holds(store, text):
    return store.query([parse_condition(text, DOMAIN, store.objects())])[0]


@pytest.fixture
def house():
    store = make_store(["a", "b", "c"])
    with store.transaction() as change:
        change.add(Fact("linked", ("home", "a")))
        change.add(Fact("linked", ("a", "b")))
        change.add(Fact("linked", ("b", "a")))
        change.add(Fact("clean", ("a",)))
        change.add(FunctionValue("size", ("a",), 4.0))
        change.add(FunctionValue("size", ("b",), 6.0))
    return store


@pytest.mark.parametrize(
    "text, expected",
    [
        ("(and)", True),
        ("(or)", False),
        ("(clean a)", True),
        ("(not (clean b))", True),
        ("(imply (clean a) (clean b))", False),
        ("(imply (clean b) (clean a))", True),
        ("(exists (?x - room) (clean ?x))", True),
        ("(forall (?x - room) (clean ?x))", False),
        ("(forall (?x ?y - room) (imply (linked ?x ?y) (reachable ?x ?y)))", True),
        ("(exists (?x - room) (and (clean ?x) (not (= ?x a))))", False),
        ("(= (+ (size a) (size b)) 10)", True),
        ("(= (- (size b) (size a)) 2)", True),
        ("(< (/ (size a) (size b)) 0.7)", True),
        ("(= (- (size a)) -4)", True),
        ("(= (* (- (size b) (size a)) (+ 1 (size a) 2)) 14)", True),
        ("(>= (size c) 0)", False),  # no value: no comparison is true, and no negation of one
        ("(< (size c) 0)", False),
        ("(not (> (size c) 0))", False),
        ("(not (= (size c) 0))", False),
        ("(not (= (size a) 0))", True),
        ("(imply (> (size c) 0) (clean b))", False),
        ("(not (and (> (size c) 0) (clean a)))", False),
        ("(not (and (> (size c) 0) (clean b)))", True),
        ("(not (exists (?x - room) (> (size ?x) 9)))", False),
        ("(not (forall (?x - room) (> (size ?x) 5)))", True),
        ("(> (/ (size a) (- 2 2)) 0)", False),
        ("(reachable home b)", True),
        ("(reachable a a)", True),
        ("(reachable b home)", False),
        ("(cut-off c)", True),
        ("(cut-off b)", False),
        ("(forall (?x - room) (or (cut-off ?x) (reachable home ?x)))", True),
    ],
)
def test_conditions(house, text, expected):
    assert holds(house, text) is expected


def test_derived_over_a_long_chain_and_a_dense_graph():
    rooms = [f"r{number}" for number in range(150)]
    store = make_store(rooms)
    with store.transaction() as change:
        for first, second in zip(rooms, rooms[1:]):
            change.add(Fact("linked", (first, second)))
    assert holds(store, "(reachable r0 r149)")
    assert not holds(store, "(reachable r149 r0)")
    dense = make_store(rooms[:12])
    with dense.transaction() as change:
        for first in rooms[:11]:
            for second in rooms[:11]:
                change.add(Fact("linked", (first, second)))
    assert not holds(dense, "(reachable r0 r11)")
