# SPDX-License-Identifier: Apache-2.0
"""Ten problems that ask different things of a planner."""

from pathlib import Path
from typing import Dict, Tuple

PDDL = Path(__file__).resolve().parents[2] / "pddl"

_BLOCKS = """(define (domain blocks) (:requirements :strips)
  (:predicates (on ?x ?y) (table ?x) (clear ?x) (free) (holding ?x))
  (:action pick-up :parameters (?x) :precondition (and (clear ?x) (table ?x) (free))
    :effect (and (not (table ?x)) (not (clear ?x)) (not (free)) (holding ?x)))
  (:action put-down :parameters (?x) :precondition (holding ?x)
    :effect (and (not (holding ?x)) (clear ?x) (free) (table ?x)))
  (:action stack :parameters (?x ?y) :precondition (and (holding ?x) (clear ?y))
    :effect (and (not (holding ?x)) (not (clear ?y)) (clear ?x) (free) (on ?x ?y)))
  (:action unstack :parameters (?x ?y) :precondition (and (on ?x ?y) (clear ?x) (free))
    :effect (and (holding ?x) (clear ?y) (not (clear ?x)) (not (free)) (not (on ?x ?y)))))"""

_COSTS = """(define (domain tour) (:requirements :typing :action-costs) (:types place)
  (:predicates (at ?p - place) (seen ?p - place))
  (:functions (total-cost) - number (way ?a ?b - place) - number)
  (:action go :parameters (?a ?b - place) :precondition (at ?a)
    :effect (and (not (at ?a)) (at ?b) (seen ?b) (increase (total-cost) (way ?a ?b)))))"""

_BATTERY = """(define (domain battery) (:requirements :typing :numeric-fluents) (:types place)
  (:predicates (at ?p - place) (seen ?p - place) (plug ?p - place)) (:functions (charge) (way ?a ?b - place))
  (:action go :parameters (?a ?b - place) :precondition (and (at ?a) (>= (charge) (way ?a ?b)))
    :effect (and (not (at ?a)) (at ?b) (seen ?b) (decrease (charge) (way ?a ?b))))
  (:action load :parameters (?p - place) :precondition (and (at ?p) (plug ?p))
    :effect (assign (charge) 10)))"""

_HARVEST = """(define (domain harvest) (:requirements :typing :numeric-fluents) (:types field)
  (:predicates (ripe ?f - field) (home)) (:functions (fruit) (yield ?f - field))
  (:action pick :parameters (?f - field) :precondition (ripe ?f)
    :effect (and (not (ripe ?f)) (increase (fruit) (yield ?f))))
  (:action go-home :parameters () :effect (home)))"""

_CELLAR = """(define (domain cellar) (:requirements :typing :durative-actions :negative-preconditions)
  (:types match fuse) (:predicates (light) (unused ?m - match) (mended ?f - fuse) (hand))
  (:durative-action strike :parameters (?m - match) :duration (= ?duration 5)
    :condition (at start (unused ?m))
    :effect (and (at start (not (unused ?m))) (at start (light)) (at end (not (light)))))
  (:durative-action mend :parameters (?f - fuse) :duration (= ?duration 2)
    :condition (and (at start (hand)) (over all (light)))
    :effect (and (at start (not (hand))) (at end (hand)) (at end (mended ?f)))))"""

_TANK = """(define (domain tank)
  (:requirements :durative-actions :fluents :continuous-effects :duration-inequalities)
  (:predicates (closed) (done)) (:functions (level))
  (:durative-action fill :parameters () :duration (and (>= ?duration 1) (<= ?duration 20))
    :condition (and (at start (closed)) (over all (<= (level) 10)))
    :effect (and (at start (not (closed))) (at end (closed)) (increase (level) (* #t 1))))
  (:durative-action sample :parameters () :duration (= ?duration 2)
    :condition (and (at start (>= (level) 3)) (at start (<= (level) 6)))
    :effect (at end (done))))"""


def _tour(size: int) -> str:
    """A ring that is cheap to walk along and dear to cross."""
    names = [f"p{number}" for number in range(size)]
    ways = " ".join(
        f"(= (way {a} {b}) {1 if (j - i) % size == 1 else 17 + (i * 7 + j * 3) % 11})"
        for i, a in enumerate(names)
        for j, b in enumerate(names)
    )
    goal = " ".join(f"(seen {name})" for name in names[1:])
    return (
        f"(define (problem p) (:domain tour) (:objects {' '.join(names)} - place) (:init (at p0) "
        f"(= (total-cost) 0) {ways}) (:goal (and {goal})) (:metric minimize (total-cost)))"
    )


def _tower(names: str, goal: str) -> str:
    blocks = names.split()
    init = " ".join(f"(table {name}) (clear {name})" for name in blocks)
    pairs = " ".join(f"(on {a} {b})" for a, b in zip(goal.split(), goal.split()[1:]))
    head = f"(define (problem p) (:domain blocks) (:objects {names})"
    return f"{head} (:init (free) {init}) (:goal (and {pairs})))"


def _of(application: str, goal: str) -> Tuple[str, str]:
    folder = PDDL / application
    problem = (folder / "problem.pddl").read_text()
    asked = "(:goal (in_service))" if application == "home" else "(:goal (quiet))"
    return (folder / "domain.pddl").read_text(), problem.replace(asked, f"(:goal (and {goal}))")


def problems() -> Dict[str, Tuple[str, str]]:
    """Name → domain and problem."""
    checks = "(checked kitchen) (checked bathroom) (checked dorm_room) (checked main_door)"
    fields = " ".join(f"(ripe f{n}) (= (yield f{n}) {n % 3})" for n in range(12))
    names = " ".join(f"f{n}" for n in range(12))
    places = (
        "(= (way a a) 1) (= (way a b) 8) (= (way b a) 8) (= (way b c) 4) (= (way c b) 4) (= (way a c) 12)"
    )
    return {
        "home, one point": _of("home", "(checked kitchen)"),
        "home, four points": _of("home", checks),
        "restaurant, six tables": _of("restaurant", " ".join(f"(checked table_{n})" for n in range(1, 7))),
        "blocks, a tower of seven": (_BLOCKS, _tower("a b c d e f g", "a b c d e f g")),
        "blocks, no such tower": (_BLOCKS, _tower("a b c", "a b c a")),
        "tour of nine, action costs": (_COSTS, _tour(9)),
        "battery, numeric": (
            _BATTERY,
            f"(define (problem p) (:domain battery) (:objects a b c - place) (:init (at a) (plug b) "
            f"(= (charge) 10) {places} (= (way c a) 12) (= (way b b) 1) (= (way c c) 1)) "
            "(:goal (and (seen c) (at a))))",
        ),
        "harvest, maximize": (
            _HARVEST,
            f"(define (problem p) (:domain harvest) (:objects {names} - field) "
            f"(:init (= (fruit) 0) {fields}) (:goal (home)) (:metric maximize (fruit)))",
        ),
        "match cellar, concurrency": (
            _CELLAR,
            "(define (problem p) (:domain cellar) (:objects m1 m2 - match f1 f2 f3 - fuse) (:init (hand) "
            "(unused m1) (unused m2)) (:goal (and (mended f1) (mended f2) (mended f3))) "
            "(:metric minimize (total-time)))",
        ),
        "tank, continuous": (
            _TANK,
            "(define (problem p) (:domain tank) (:init (closed) (= (level) 0)) (:goal (done)))",
        ),
    }
