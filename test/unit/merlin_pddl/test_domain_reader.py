# SPDX-License-Identifier: Apache-2.0
import pytest

from merlin_pddl.domain import depends_on
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import END, OVER_ALL, START, And, Atom, Comparison, Forall, to_pddl
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.text_reader import PddlError, read_text

RICH = """
; every construct that a knowledge base has to understand
(define (domain Rich)
  (:requirements :adl :durative-actions :fluents :derived-predicates)
  (:types room - object robot person - agent agent door table)
  (:constants HOME - room)
  (:predicates (at ?a - agent ?r - room) (linked ?a ?b - room) (reachable ?a ?b - room)
               (clean ?r - room) (holds ?x - (either door table)) (busy ?r - robot) (loose ?x))
  (:functions (battery ?r - robot) - number (distance ?a ?b - room) (total-cost))
  (:derived (reachable ?a ?b - room)
    (or (linked ?a ?b) (exists (?c - room) (and (linked ?a ?c) (reachable ?c ?b)))))
  (:action tidy
    :parameters (?r - robot ?place - room)
    :precondition (and (at ?r ?place) (not (clean ?place)) (>= (battery ?r) 10)
                       (or (busy ?r) (= ?place home)) (imply (busy ?r) (clean home)))
    :effect (and (clean ?place) (decrease (battery ?r) 5) (increase (total-cost) 1)
                 (forall (?p - person) (when (at ?p ?place) (not (at ?p ?place))))))
  (:durative-action drive
    :parameters (?r - robot ?from ?to - room)
    :duration (and (>= ?duration 1) (<= ?duration (/ (distance ?from ?to) 2)))
    :condition (and (at start (at ?r ?from)) (forall (?p - person) (over all (not (at ?p ?to))))
                    (at end (reachable ?from ?to)))
    :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to))
                 (decrease (battery ?r) (* #t 0.5))
                 (when (at start (busy ?r)) (at end (clean ?to))))))
"""


@pytest.fixture(scope="module")
def rich():
    return parse_domain(RICH)


def test_types_keep_order_and_hierarchy(rich):
    assert rich.name == "rich"
    assert list(rich.types) == ["room", "robot", "person", "agent", "door", "table"]
    assert rich.types.subtypes("agent") == {"agent", "robot", "person"}
    assert rich.types.is_a("robot", "object") and not rich.types.is_a("agent", "robot")
    assert rich.types.is_a("undeclared", "object")
    assert rich.constants == {"home": ("room",)}


def test_constants_of_types_below_belong_to_a_type(rich):
    assert rich.constants_of("room") == rich.constants_of("object") == ["home"]
    assert rich.constants_of("object", subtypes=False) == []
    assert rich.only_constant(("object",)) == "home" and rich.only_constant(("agent",)) is None


def test_signatures(rich):
    assert [p.label for p in rich.predicates["at"].parameters] == ["a", "r"]
    assert rich.predicates["holds"].parameters[0].types == ("door", "table")
    assert rich.predicates["loose"].parameters[0].types == ("object",)
    assert rich.functions["distance"].parameters[1].types == ("room",)


def test_plain_operator(rich):
    tidy = rich.operators["tidy"]
    assert not tidy.durative and tidy.durations == ()
    assert to_pddl(tidy.conditions[0].condition) == (
        "(and (at ?r ?place) (not (clean ?place)) (>= (battery ?r) 10) (or (busy ?r) (= ?place home)) "
        "(or (not (busy ?r)) (clean home)))"
    )
    leave = tidy.effects[-1]
    assert leave.negative and leave.atom == Atom("at", ("?p", "?place"))
    assert leave.variables[0].types == ("person",) and leave.conditions[0].when == START


def test_an_empty_condition_always_holds():
    domain = parse_domain("(define (domain d) (:action go :parameters () :precondition () :effect (and)))")
    assert [timed.condition for timed in domain.operators["go"].conditions] == [And()]


def test_durative_operator(rich):
    drive = rich.operators["drive"]
    assert drive.durative and [d.op for d in drive.durations] == [">=", "<="]
    assert [timed.when for timed in drive.conditions] == [START, OVER_ALL, END]
    assert isinstance(drive.conditions[1].condition, Forall)
    assert [effect.when for effect in drive.effects] == [START, END, OVER_ALL, END]
    assert drive.effects[3].conditions[0].when == START


def test_problem(rich):
    problem = parse_problem(
        """(define (problem p) (:domain rich) (:objects r2 - robot hall - room Ann - person)
           (:init (at r2 hall) (= (battery r2) 50) (= (distance hall home) (* 2 (battery r2)))
                  (not (clean hall)) (at 5 (at ann hall)) (at 7.5 (= (battery r2) 3)))
           (:goal (and (clean hall) (not (at ann hall)) (> (battery r2) 1) (or (busy r2) (clean home))))
           (:metric minimize (+ (total-cost) (* 2 (total-time)))))""",
        rich,
    )
    assert problem.objects == {"r2": ("robot",), "hall": ("room",), "ann": ("person",)}
    assert [value.value for value in problem.values] == [50.0, 100.0]
    assert [row.at for row in problem.timed] == [5_000_000_000, 7_500_000_000]
    assert len(problem.goals) == 4 and isinstance(problem.goals[2], Comparison)
    assert to_pddl(problem.metric.value) == "(+ (total-cost) (* 2 (total-time)))"


BROKEN = [
    ("(define (domain d) (:types a - b b - a))", "1:20", "its own ancestor"),
    ("(define (domain d)\n (:predicates (p ?x - nothing)))", "2:23", "unknown type 'nothing'"),
    ("(define (domain d) (:predicates (p) (p)))", "1:38", "declared twice"),
    ("(define (domain d)", "1:1", "never closed"),
    ("(define (domain d)))", "1:20", "closes nothing"),
    ("(define (domain d) (:typos))", "1:20", "unknown section"),
    ("", "1:1", "no PDDL"),
    ("hello", "1:1", "expected '('"),
    ("(define (problem d))", "1:9", "expected (domain <name>)"),
    (
        "(define (domain d) (:predicates (checked)) (:action a :precondition (cheked)))",
        "1:70",
        "did you mean",
    ),
    ("(define (domain d) (:predicates (p ?x)) (:action a :effect (p)))", "1:60", "takes 1 argument"),
    ("(define (domain d) (:predicates (p ?x)) (:action a :effect (p ?y)))", "1:63", "unknown variable '?y'"),
    ("(define (domain d) (:predicates (p ?x)) (:action a :effect (p y)))", "1:63", "unknown object 'y'"),
    ("(define (domain d) (:action a :parameters (?x ?x)))", "1:47", "stands twice"),
    ("(define (domain d) (:action a :efect (p)))", "1:31", "expected one of :parameters"),
    ("(define (domain d) (:durative-action a :effect ()))", "1:38", "no :duration"),
    (
        "(define (domain d) (:predicates (p)) (:durative-action a :duration (= ?duration 1) :effect (p)))",
        "1:92",
        "expected (at start ...)",
    ),
    (
        "(define (domain d) (:types a b) (:predicates (p ?x - a)) (:action o :parameters (?y - b) "
        ":precondition (p ?y)))",
        "1:107",
        "is of type b",
    ),
    ("(define (domain d) (:predicates (p)) (:derived (p) (not (p))))", "1:38", "depends on its own negation"),
    ("(" * 200 + ")" * 200, "1:101", "nested deeper than"),
]


@pytest.mark.parametrize("text, place, reason", BROKEN)
def test_errors_say_where_and_what(text, place, reason):
    with pytest.raises(PddlError) as caught:
        parse_domain(text, "broken.pddl")
    assert str(caught.value).startswith(f"broken.pddl:{place}: ")
    assert reason in str(caught.value)


BROKEN_PROBLEMS = [
    ("(:domain other)", "belongs to the domain 'other'"),
    ("(:domain rich) (:objects a - room) (:init (at a a))", "is of type room"),
    ("(:domain rich) (:objects a - room) (:init (clean b))", "unknown object 'b'"),
    ("(:domain rich) (:objects a - rom)", "did you mean 'room'"),
    ("(:domain rich) (:init (at -5 (clean home)))", "between 0 and 4294967296 s"),
    ("(:domain rich) (:init (at 1e300 (clean home)))", "between 0 and 4294967296 s"),
    ("(:domain rich) (:init (= (total-cost) (battery home)))", "is of type room"),
    ("(:domain rich) (:goal (clean home) (clean home))", "expected (:goal"),
    ("(:domain rich) (:metric best 1)", "expected (:metric"),
]


@pytest.mark.parametrize("sections, reason", BROKEN_PROBLEMS)
def test_errors_in_problems(rich, sections, reason):
    with pytest.raises(PddlError, match="problem.pddl:1:[0-9]+: ") as caught:
        parse_problem(f"(define (problem x) {sections})", rich, "problem.pddl")
    assert reason in str(caught.value)


CHAIN = """(define (domain chain) (:requirements :derived-predicates :fluents)
  (:predicates (ready) (fed) (awake) (other)) (:functions (charge))
  (:derived (ready) (and (fed) (not (awake)))) (:derived (fed) (or (fed) (> (charge) 3)))
  (:action go :parameters () :precondition (ready) :effect (other)))"""


def test_a_condition_depends_on_what_its_rules_depend_on():
    domain = parse_domain(CHAIN)
    condition = Atom("ready", ())
    assert depends_on(condition, domain.derived) == {"ready", "fed", "awake", "charge"}
    assert depends_on(Atom("other", ()), domain.derived) == {"other"}


def test_a_word_keeps_the_spelling_and_the_place_that_it_has_in_the_text():
    (found,) = read_text("\n  (Drive HALL)", "a.pddl")
    assert [(word, word.written, word.source, word.line, word.column) for word in found] == [
        ("drive", "Drive", "a.pddl", 2, 4),
        ("hall", "HALL", "a.pddl", 2, 10),
    ]
