# SPDX-License-Identifier: Apache-2.0
"""Facts and goals in Python are found and judged by a domain; numbers that are missing are named."""

import contextlib
import gc
import sys
import threading
import traceback
from pathlib import Path
from typing import Any, Iterator, List

import pytest

from merlin_pddl.checks.literals import literal_fault, literals_of
from merlin_pddl.checks.values import CUT_OFF, missing_values, open_durations
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.problem_reader import parse_problem

DOMAIN = parse_domain(
    """(define (domain d) (:types room cup) (:predicates (clean ?r - room) (on ?c - cup ?r - room))
    (:functions (battery) (way ?a ?b - room))
    (:action wipe :parameters (?r ?other - room) :precondition (and (clean ?other)
      (> (battery) (way ?other ?r)))
      :effect (and (clean ?r) (decrease (battery) 1)))
    (:action load :parameters () :effect (assign (battery) 100)))"""
)
OBJECTS = {"hall": ("room",), "attic": ("room",), "mug": ("cup",)}


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("(clean hall)", ""),
        ("(not (clean {_}))", ""),
        ("(and (clean {_}) (>= (battery) {level}))", ""),
        ("(> (battery) (+ (way hall attic) (way attic hall) 1))", ""),
        ("(clean {_}) (>= (battery) {level})", "nothing may follow the closing parenthesis"),
        ("(> battery 10)", "'battery' is neither a number nor a function"),
        ("(or (clean hall) (clean attic))", "'or' cannot stand in such a goal"),
        ("(and (forall (?r - room) (clean ?r)))", "'forall' cannot stand in such a goal"),
        ("(preference p (clean hall))", "'preference' cannot stand in such a goal"),
        ("(not (and (clean hall) (clean attic)))", "only a plain fact can be negated"),
        ("(not (> (battery) 3))", "only a plain fact can be negated"),
        ("()", "an empty or nested pair of parentheses where a name is expected"),
        ("(clean room_{n})", ""),
        ("({_} hall)", ""),
        ("no PDDL", ""),
        ("(cleen hall)", "unknown predicate 'cleen' (did you mean 'clean'?)"),
        ("(clean hal)", "unknown object 'hal' (did you mean 'hall'?)"),
        ("(clean {a} {b})", "'clean' takes 1 argument(s), here are 2"),
        ("(clean mug)", "'mug' is of type cup, but 'clean' takes room here"),
        ("(on {r} hall)", "'?r' is of type room, but 'on' takes cup here"),
    ],
)
def test_a_literal_is_judged(text: str, fault: str) -> None:
    assert literal_fault(text, DOMAIN, OBJECTS, "wipe") == fault


def test_an_object_that_may_come_later_is_no_mistake() -> None:
    assert literal_fault("(clean cellar)", DOMAIN, OBJECTS, adds_objects=True) == ""


class Base:
    def send(self, goals: Any) -> None: ...


class Mine(Base):
    def run(self, name: str, all_of_it: List[str]) -> None:
        self.send("(clean hall)")
        self.send([f"(clean {name})", "(on mug hall)"] if name else "(clean attic)")
        self.send(goals=(f"(clean {each})" for each in all_of_it))
        self.send(name)


class Heir(Mine):
    pass


def test_the_literals_of_a_class_and_of_what_it_inherits() -> None:
    found = literals_of(Heir, {"send": 0}, (Base,))
    texts = ["(clean hall)", "(clean {_})", "(on mug hall)", "(clean attic)", "(clean {_})"]
    assert [text for _, text in found] == texts
    source = Path(__file__).read_text().splitlines()
    place, _, line = found[0].where.rpartition(", line ")
    assert place == Path(__file__).name and "(clean hall)" in source[int(line) - 1]


@contextlib.contextmanager
def parsed_elsewhere() -> Iterator[None]:
    """Another thread formats tracebacks, and is let in at every collection of garbage."""
    over = threading.Event()

    def failing(depth: int) -> None:
        try:
            [][0] if not depth else failing(depth - 1)
        except IndexError:
            with contextlib.suppress(SystemError):
                traceback.format_exc()

    def fail() -> None:
        while not over.is_set():
            failing(20)

    def collected(phase: str, info: Any) -> None:
        sum(range(200))

    limits, interval = gc.get_threshold(), sys.getswitchinterval()
    other = threading.Thread(target=fail, name="tracebacks")
    gc.callbacks.append(collected)
    gc.set_threshold(50, 2, 2)
    sys.setswitchinterval(1e-5)
    other.start()
    try:
        yield
    finally:
        over.set()
        other.join()
        sys.setswitchinterval(interval)
        gc.set_threshold(*limits)
        gc.callbacks.remove(collected)


def test_a_class_is_read_while_another_thread_formats_a_traceback() -> None:
    with parsed_elsewhere():
        found = [literals_of(Heir, {"send": 0}, (Base,)) for _ in range(20)]
    assert all(found) and len({str(each) for each in found}) == 1
    assert gc.isenabled()


def problem(init: str) -> Any:
    text = (
        f"(define (problem p) (:domain d) (:objects hall attic - room) (:init {init}) (:goal (clean attic)))"
    )
    return parse_problem(text, DOMAIN)


def test_a_number_that_is_missing_is_named_with_its_operator() -> None:
    (said,) = missing_values(DOMAIN, problem("(clean hall) (= (battery) 5)"))
    assert said.startswith("operator wipe needs the value of (way hall attic): no plan")
    assert missing_values(DOMAIN, problem("(clean hall) (= (battery) 5) (= (way hall attic) 1)")) == [
        said.replace("hall attic", "attic hall")
    ]


@pytest.mark.parametrize(
    ("duration", "said"),
    [
        ("(= ?duration -6)", ["operator wash has a negative duration: (wash "]),
        ("(= ?duration (- (long ?r) 5))", ["operator wash has a negative duration: (wash hall) lasts -2 s"]),
        ("(and (>= ?duration -3) (<= ?duration -1))", ["operator wash has a negative duration"]),
        ("(>= ?duration -3)", []),
        ("(= ?duration 0)", []),
    ],
)
def test_a_negative_duration_is_named_with_an_action(duration: str, said: List[str]) -> None:
    domain = parse_domain(
        f"""(define (domain d) (:types room) (:predicates (clean ?r - room)) (:functions (long ?r - room))
        (:durative-action wash :parameters (?r - room) :duration {duration} :effect (at end (clean ?r))))"""
    )
    text = """(define (problem p) (:domain d) (:objects hall attic - room)
        (:init (= (long hall) 3) (= (long attic) 8)) (:goal (clean attic)))"""
    found = missing_values(domain, parse_problem(text, domain))
    assert len(found) == len(said) and all(line.startswith(begin) for line, begin in zip(found, said))


def test_what_an_action_assigns_is_not_missing() -> None:
    ways = "(= (way hall attic) 1) (= (way attic hall) 1)"
    assert missing_values(DOMAIN, problem(f"(clean hall) {ways}")) == []


def test_what_plans_cost_need_not_have_a_value() -> None:
    action = "(:action a :parameters () :effect (and (p) (increase (total-cost) 1) (decrease (n) 1)))"
    domain = parse_domain(f"(define (domain d) (:predicates (p)) (:functions (total-cost) (n)) {action})")
    found = missing_values(domain, parse_problem("(define (problem p) (:domain d) (:goal (p)))", domain))
    assert [line.split(":")[0] for line in found] == ["operator a needs the value of (n)"]


def test_a_task_that_is_too_large_is_said_not_to_be_looked_at() -> None:
    assert missing_values(DOMAIN, problem("(clean hall)"), limit=-1.0) == [CUT_OFF]


@pytest.mark.parametrize(
    ("duration", "effect", "mistakes", "warnings"),
    [
        ("(<= ?duration 9)", "(at start (increase (battery) ?duration))", 1, 0),
        ("(<= ?duration 9)", "(at end (increase (battery) (* 2 ?duration)))", 0, 1),
        ("(<= ?duration 9)", "(increase (battery) (* #t 2))", 0, 1),
        ("(<= ?duration 9)", "(at start (increase (battery) 3))", 0, 0),
        ("(= ?duration 9)", "(at start (increase (battery) ?duration))", 0, 0),
    ],
)
def test_effects_that_need_an_open_duration_are_named(
    duration: str, effect: str, mistakes: int, warnings: int
) -> None:
    domain = parse_domain(
        f"""(define (domain d) (:functions (battery))
        (:durative-action charge :parameters () :duration {duration} :effect (and {effect})))"""
    )
    for at_start, number in ((True, mistakes), (False, warnings)):
        said = open_durations(domain, at_start)
        assert len(said) == number
        assert all(text.startswith("operator charge") and "write (= ?duration …)" in text for text in said)
