# SPDX-License-Identifier: Apache-2.0
"""The text of a generated problem, byte for byte as ROSPlan's clients know it."""

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore

DOMAIN = parse_domain("""(define (domain d)
    (:requirements :typing :fluents :timed-initial-literals)
    (:types place robot)
    (:predicates (connected ?a ?b - place) (at ?r - robot ?p - place) (open ?p - place) (idle))
    (:functions (battery ?r - robot) (distance ?a ?b - place) (speed)))""")


def text(problem):
    store = KnowledgeStore(DOMAIN, clock=lambda: 0)
    store.load_problem(parse_problem(problem, DOMAIN))
    return write_problem(store.snapshot()[1], DOMAIN)


def test_an_empty_line_follows_every_group_also_an_empty_one():
    assert text("""(define (problem p) (:domain d) (:objects a b - place r2 r1 - robot)
        (:init (= (speed) 0.5) (idle) (at r1 a) (connected a b) (not (connected b a)) (= (battery r1) 20)
               (at 5 (open a)) (at 9 (not (open a))))
        (:goal (and (at r1 b) (not (idle)) (> (battery r1) 5))) (:metric minimize (total-time)))""") == (
        """(define (problem task)
(:domain d)
(:objects
    a b - place
    r2 r1 - robot
)
(:init
    (connected a b)
    (not (connected b a))

    (at r1 a)


    (at 5 (open a))
    (at 9 (not (open a)))

    (idle)

    (= (battery r1) 20)


    (= (speed) 0.5)

)
(:goal (and
    (at r1 b)
    (not (idle))
    (> (battery r1) 5)
))
(:metric minimize (total-time))
)
"""
    )


def test_nothing_known_is_groups_without_lines():
    assert "(:init\n\n\n\n\n\n\n\n)\n" in text("(define (problem p) (:domain d))")
