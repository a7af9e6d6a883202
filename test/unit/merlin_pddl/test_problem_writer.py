# SPDX-License-Identifier: Apache-2.0
import kairos

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import to_pddl
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Timed
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore

DOMAIN_TEXT = """(define (domain d)
    (:requirements :adl :numeric-fluents :timed-initial-literals)
    (:types place - object poi table - place robot)
    (:constants anywhere - place)
    (:predicates (robot_at ?p - place) (checked ?p - poi) (idle))
    (:functions (battery ?r - robot) (limit))
    (:action wait :parameters () :effect (idle)))"""
DOMAIN = parse_domain(DOMAIN_TEXT)
PROBLEM = """(define (problem everything) (:domain d)
    (:objects kitchen hall - poi bar - (either poi table) attic - place r1 r2 - robot thing - object)
    (:init (checked hall) (robot_at attic) (not (checked kitchen)) (= (battery r1) 0.30000000000000004)
           (= (battery r2) 1e-7) (= (limit) -12345678901234567890) (at 5 (robot_at hall))
           (at 7.25 (not (robot_at hall))) (at 9 (= (limit) 3)))
    (:goal (and (checked kitchen) (not (robot_at attic)) (>= (battery r1) (- (* 2 (limit)) (/ (limit) 4) ))
                (or (idle) (forall (?p - poi) (checked ?p))) (not (> (limit) 3))))
    (:metric maximize (+ (* 2 (battery r1)) (- (total-time)))))"""


def loaded(text):
    store = KnowledgeStore(DOMAIN)
    store.load_problem(parse_problem(text, DOMAIN))
    return store


def test_nothing_is_lost_on_the_way_through_the_store():
    text = PROBLEM.replace("(- (* 2 (limit)) (/ (limit) 4) )", "(+ (* 2 (limit)) (/ (limit) 4) 1)")
    stated = parse_problem(text, DOMAIN)
    written = write_problem(loaded(text).snapshot()[1], DOMAIN)
    found = parse_problem(written, DOMAIN)
    assert found.objects == stated.objects
    assert [fact.text() for fact in found.facts] == [
        "(robot_at attic)",
        "(checked hall)",
        "(not (checked kitchen))",
    ]
    assert {v.text(): v.value for v in found.values} == {v.text(): v.value for v in stated.values}
    assert [(row.at, row.item.text()) for row in found.timed] == [
        (row.at, row.item.text()) for row in stated.timed
    ]
    assert [to_pddl(goal) for goal in found.goals] == [to_pddl(goal) for goal in stated.goals]
    assert to_pddl(found.metric.value) == to_pddl(stated.metric.value)


def test_object_of_nested_types_is_written_once_with_the_narrower_one():
    text = "(define (problem p) (:domain d) (:objects a - place a - poi b - robot))"
    assert "    a - poi\n    b - robot\n" in write_problem(loaded(text).snapshot()[1], DOMAIN)


def test_empty_knowledge_is_a_problem_too():
    written = write_problem(KnowledgeStore(DOMAIN).snapshot()[1], DOMAIN)
    assert parse_problem(written, DOMAIN).goals == []


def test_independent_reader_accepts_it():
    written = write_problem(loaded(PROBLEM).snapshot()[1], DOMAIN)
    report = kairos.check_problem(written, DOMAIN_TEXT)
    assert report.valid, [str(found) for found in report.diagnostics]


def test_timed_changes_of_a_number_are_written_as_the_values_that_they_give():
    _, problem = loaded(
        "(define (problem p) (:domain d) (:objects r1 r2 - robot) (:init (= (battery r1) 20)))"
    ).snapshot()
    changes = [
        (9, FunctionValue("battery", ("R1",), 3.0, op="scale-up")),
        (5, FunctionValue("battery", ("r1",), 5.0, op="increase")),
        (6, FunctionValue("battery", ("r2",), 1.0, op="increase")),  # of what has no value
        (7, Instance("robot", "r3")),
        (8, FunctionValue("limit", (), 4.0)),
        (10, FunctionValue("limit", (), 1.0, op="decrease")),
    ]
    problem.timed = [Timed(second * 10**9, item) for second, item in changes]
    written = write_problem(problem, DOMAIN)
    assert [line.strip() for line in written.splitlines() if "(at " in line] == [
        "(at 5 (= (battery r1) 25))",
        "(at 8 (= (limit) 4))",
        "(at 9 (= (battery R1) 75))",
        "(at 10 (= (limit) 3))",
    ]


def test_of_two_timed_changes_at_one_moment_the_last_is_written():
    """Of two, even of equal ones, kairos finds no plan; a knowledge base applies them in their order."""
    _, problem = loaded("(define (problem p) (:domain d) (:objects a - poi r1 - robot))").snapshot()
    checked, twice = Fact("checked", ("a",)), Fact("checked", ("A",))
    left, full = (FunctionValue("battery", ("r1",), value) for value in (5.0, 90.0))
    changes = [
        (5, checked),
        (5, twice),
        (6, checked),
        (6, Fact("checked", ("a",), True)),
        (7, left),
        (7, full),
    ]
    problem.timed = [Timed(second * 10**9, item) for second, item in changes]
    written = write_problem(problem, DOMAIN)
    assert [line.strip() for line in written.splitlines() if "(at " in line] == [
        "(at 5 (checked A))",
        "(at 6 (not (checked a)))",
        "(at 7 (= (battery r1) 90))",
    ]
