# SPDX-License-Identifier: Apache-2.0
"""Why a task has no plan, and that nothing is called unreachable that a plan can reach."""

import itertools
import time
from pathlib import Path
from typing import Tuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_pddl.analysis.leave_out import leave_out
from merlin_pddl.analysis.plan_run import PlanRun
from merlin_pddl.analysis.ranges import Range, arithmetic, can_compare
from merlin_pddl.analysis.reachability import Reachability
from merlin_pddl.analysis.shortfall import CUT_OFF, TOGETHER, shortfall
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.evaluation import compare
from merlin_pddl.plan_text import PlanStep
from merlin_pddl.problem_reader import parse_problem
from merlin_test import LONG

FOLDER = Path(__file__).parents[4] / "src" / "merlin" / "pddl"
COURIER = """(define (domain courier)
  (:types place box)
  (:predicates (at ?p - place) (in ?b - box ?p - place) (door ?from ?to - place) (dirty) (safe))
  (:functions (battery) (needed ?from ?to - place))
  (:action drive :parameters (?from ?to - place)
    :precondition (and (at ?from) (door ?from ?to) (>= (battery) (needed ?from ?to)))
    :effect (and (at ?to) (not (at ?from)) (decrease (battery) 1)))
  (:action deliver :parameters (?b - box ?from ?to - place)
    :precondition (and (in ?b ?from) (at ?to) (>= (battery) 13) (not (dirty)))
    :effect (and (in ?b ?to) (not (in ?b ?from)))))"""
INIT = "(at hall) (in box_1 hall) (door hall ward) (= (needed hall ward) 5) (= (battery) 12.2)"


def task(goal: str, init: str = INIT) -> str:
    return f"""(define (problem day) (:domain courier) (:objects hall ward roof - place box_1 - box)
      (:init {init}) (:goal (and {goal})))"""


def test_a_machine_that_stalls_cuts_nothing_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "monotonic", itertools.count(0.0, LONG).__next__)
    why = "cannot be reached: (safe); no action can make it true"
    assert shortfall(COURIER, task("(safe)")) == (True, why)
    assert shortfall(COURIER, task("(safe)"), limit=0.0) == (False, CUT_OFF.format(limit=0))


@pytest.mark.parametrize(
    ("goal", "init", "expected"),
    [
        (
            "(in box_1 ward)",
            INIT,
            "(in box_1 ward) cannot be reached, it needs "
            "(>= (battery) 13) for deliver; at most 12.2 can be reached",
        ),
        ("(>= (battery) 20)", INIT, "cannot be reached: (>= (battery) 20); at most 12.2 can be reached"),
        ("(<= 20 (battery))", INIT, "cannot be reached: (<= 20 (battery)); at most 12.2 can be reached"),
        (
            "(at ward)",
            INIT.replace("12.2", "3"),
            "(at ward) cannot be reached, it needs (>= (battery) (needed hall ward)) for drive; "
            "at most 3 can be reached, 5 is needed",
        ),
        ("(safe)", INIT, "cannot be reached: (safe); no action can make it true"),
        (
            "(in box_1 ward)",
            INIT.replace("12.2", "20") + "(dirty)",
            "(in box_1 ward) cannot be reached, it needs "
            "(not (dirty)) for deliver; no action can make it false",
        ),
        (
            "(at ward)",
            INIT.replace("(= (needed hall ward) 5)", ""),
            "(at ward) cannot be reached, it needs (needed hall ward) for drive; it has no value",
        ),
    ],
)
def test_it_names_the_condition_and_by_how_much_it_is_missed(goal: str, init: str, expected: str) -> None:
    assert shortfall(COURIER, task(goal, init), LONG) == (True, expected)


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        ("(increase (load) 1)", "it needs (load) for go; it has no value"),
        ("(assign (cost) (load))", "it needs (load) for go; it has no value"),
        ("(when (> (cost) (load)) (increase (load) 1))", TOGETHER),
        ("(increase (total-cost) 1)", TOGETHER),
    ],
)
def test_a_number_that_an_effect_needs_is_named(effect: str, expected: str) -> None:
    domain = f"""(define (domain d) (:predicates (gone) (not-gone)) (:functions (load) (cost) (total-cost))
      (:action go :parameters () :precondition (not-gone) :effect (and (gone) (not (not-gone)) {effect})))"""
    start = "(define (problem p) (:domain d) (:init (not-gone) (= (cost) 1)) (:goal (and (gone) {})))"
    assert expected in shortfall(domain, start.format(""), LONG)[1]
    # A comparison without a value does not hold, nor does its negation.
    assert shortfall(domain, start.format("(not (= (load) 3))"), LONG)[0]


def test_of_many_goals_two_are_named() -> None:
    found, why = shortfall(COURIER, task("(safe) (at roof) (dirty) (in box_1 roof)"), LONG)
    assert found and why.startswith("cannot be reached: (safe); ") and why.endswith("; and 2 more goals")


def test_objects_that_do_not_belong_together_are_no_reason() -> None:
    museum = """(define (domain museum) (:types place picture door)
      (:predicates (at ?p - place) (shown_in ?o - picture ?p - place) (joins ?a ?b - place ?d - door)
        (passable ?d - door) (told ?o - picture))
      (:action go :parameters (?a ?b - place ?d - door)
        :precondition (and (at ?a) (joins ?a ?b ?d) (passable ?d)) :effect (and (at ?b) (not (at ?a))))
      (:action tell :parameters (?o - picture ?p - place)
        :precondition (and (at ?p) (shown_in ?o ?p)) :effect (told ?o)))"""
    day = """(define (problem day) (:domain museum)
      (:objects foyer hall vault - place crown - picture hall_door vault_door - door)
      (:init (at foyer) (joins foyer hall hall_door) (joins hall vault vault_door) (passable hall_door)
        (shown_in crown vault)) (:goal (told crown)))"""
    found, why = shortfall(museum, day, LONG)
    assert found and "it needs (passable vault_door) for go; no action can make it true" in why


def test_it_follows_a_condition_back_to_its_reason() -> None:
    found, why = shortfall(COURIER, task("(at roof)"), LONG)
    assert found and why.startswith("(at roof) cannot be reached, it needs (door ")
    assert why.endswith("roof) for drive; no action can make it true")


@pytest.mark.parametrize("taken", ["", "(left-out-drive)"])
def test_an_action_that_was_left_out_is_named(taken: str) -> None:
    courier = COURIER.replace("(:predicates", f"(:predicates {taken}")
    domain, problem = leave_out(courier, task("(at ward)"), ["(drive * ward)"])
    found, why = shortfall(domain, problem, LONG)
    assert found and why == "(at ward) cannot be reached, it needs (drive hall ward); it was given up"


def test_what_can_be_reached_for_itself_is_not_called_unreachable() -> None:
    assert shortfall(COURIER, task("(at ward) (at hall)"), LONG) == (False, TOGETHER)
    assert shortfall(COURIER, task("(<= (battery) 3)"), LONG) == (False, TOGETHER)


@pytest.mark.parametrize(("goal", "row"), [("(safe)", "(safe)"), ("(>= (battery) 20)", "(= (battery) 20)")])
def test_what_comes_at_a_time_can_be_reached(goal: str, row: str) -> None:
    assert shortfall(COURIER, task(goal, f"{INIT} (at 5 {row})"), LONG) == (False, TOGETHER)


def test_places_that_lead_to_each_other_only_are_no_reason() -> None:
    doors = "(door ward roof) (door roof ward) (= (needed ward roof) 5) (= (needed roof ward) 5)"
    init = INIT.replace("(door hall ward)", doors)
    found, why = shortfall(COURIER, task("(at roof)", init), LONG)
    assert found and why.startswith("(at roof) cannot be reached, it needs (door hall ")


def test_it_ends_in_time_and_says_so() -> None:
    objects = " ".join(f"p{number}" for number in range(300))
    doors = " ".join(f"(door p{a} p{b})" for a in range(0, 300, 3) for b in range(0, 300, 3))
    problem = f"""(define (problem day) (:domain courier) (:objects {objects} - place box_1 - box)
      (:init (at p0) {doors} (= (battery) 50)) (:goal (safe)))"""
    found, why = shortfall(COURIER, problem, 0.0)
    assert (found, why) == (False, "why was not found out within 0 s")


def test_what_is_not_pddl_is_left_to_the_planner() -> None:
    assert shortfall("(define", task("(safe)")) == (False, "")


def application(name: str) -> Tuple[str, str]:
    return tuple((FOLDER / name / file).read_text() for file in ("domain.pddl", "problem.pddl"))  # type: ignore


@pytest.mark.parametrize("name", ["home", "restaurant"])
def test_everything_that_the_applications_do_can_be_reached(name: str) -> None:
    domain_text, problem_text = application(name)
    domain = parse_domain(domain_text)
    if "client" in domain.types:  # those of the restaurant come later
        problem_text = problem_text.replace("(:objects", "(:objects ann - client", 1)
    problem = parse_problem(problem_text, domain, constraints=True)
    reach = Reachability(domain, problem, time.thread_time() + LONG)
    effects = [effect for action in domain.operators.values() for effect in action.effects]
    made = {effect.atom.name for effect in effects if effect.atom and not effect.negative}
    for predicate in domain.predicates.values():
        if predicate.name not in made:  # what is perceived
            for bindings in reach.state.extend(predicate.parameters, {}):
                reach.state.add((predicate.name, *bindings.values()))
    reach.run()
    for operator in domain.operators.values():
        needs = [timed.condition for timed in operator.conditions]
        assert next(reach.state.matches(operator.parameters, needs), None) is not None, operator.name


# --- nothing that is reached by a walk is called unreachable ------------------------------------------

numbers = st.integers(-4, 4)
ranges = st.tuples(numbers, numbers).map(lambda pair: Range(float(min(pair)), float(max(pair))))


@given(st.sampled_from("+-*/"), ranges, ranges, st.data())
def test_arithmetic_of_ranges_holds_all_results(op: str, a: Range, b: Range, data: st.DataObject) -> None:
    left = data.draw(st.floats(a.low, a.high))
    right = data.draw(st.floats(b.low, b.high))
    if op == "/" and abs(right) < 1e-6:
        return
    value = {"+": left + right, "-": left - right, "*": left * right}.get(op, left / (right or 1.0))
    found = arithmetic(op, [a, b])
    assert found.low - 1e-6 <= value <= found.high + 1e-6


@given(st.sampled_from([">", ">=", "<", "<=", "="]), ranges, ranges, st.booleans(), st.data())
def test_a_comparison_that_holds_somewhere_can_hold(
    op: str, a: Range, b: Range, negated: bool, data: st.DataObject
) -> None:
    left, right = data.draw(st.floats(a.low, a.high)), data.draw(st.floats(b.low, b.high))
    if compare(op, left, right) != negated:
        assert can_compare(op, a, b, negated)


LAMPS = """(define (domain lamps) (:types place)
  (:predicates (at ?p - place) (door ?a ?b - place) (locked ?p - place) (lit ?p - place) (bright))
  (:functions (power) (needed ?p - place))
  (:derived (bright) (forall (?p - place) (or (lit ?p) (locked ?p))))
  (:action go :parameters (?a ?b - place)
    :precondition (and (at ?a) (or (door ?a ?b) (door ?b ?a)) (not (= ?a ?b)) (not (locked ?b)))
    :effect (and (at ?b) (not (at ?a))))
  (:durative-action unlock :parameters (?p - place) :duration (= ?duration (needed ?p))
    :condition (at start (exists (?q - place) (and (at ?q) (door ?q ?p))))
    :effect (and (at end (not (locked ?p))) (at end (decrease (power) (* 0.5 ?duration)))))
  (:action light :parameters ()
    :effect (forall (?p - place) (when (and (not (locked ?p)) (>= (power) (needed ?p))) (lit ?p))))
  (:action charge :parameters () :precondition (< (power) 3) :effect (assign (power) 3))
  (:action halve :parameters () :precondition (bright) :effect (scale-down (power) 2))
  (:action save :parameters () :precondition (> (power) 1) :effect (scale-up (power) 2)))"""
PLACES = ["p0", "p1", "p2"]
place = st.sampled_from(PLACES)
step = st.one_of(
    st.tuples(st.just("go"), place, place),
    st.tuples(st.just("unlock"), place),
    st.tuples(st.sampled_from(["light", "charge", "halve", "save"])),
)
GOALS = " ".join(
    [
        *(f"({head} {name}) (not ({head} {name}))" for head in ("at", "locked", "lit") for name in PLACES),
        *(f"({op} (power) {number})" for op in ("<", "<=", "=", ">=", ">") for number in (-1, 1.5, 3, 4, 6)),
        "(bright) (not (bright)) (forall (?p - place) (lit ?p)) (exists (?p - place) (lit ?p))",
        "(not (exists (?p - place) (locked ?p))) (not (and (lit p0) (at p0))) (< (- (power)) -2)",
    ]
)


@settings(max_examples=200, deadline=None)
@given(
    doors=st.sets(st.tuples(place, place), max_size=4),
    locked=st.sets(place),
    power=st.one_of(st.none(), st.integers(0, 6)),
    needed=st.lists(st.integers(1, 8), min_size=len(PLACES), max_size=len(PLACES)),
    steps=st.lists(step, max_size=10),
)
def test_all_that_a_plan_reaches_can_be_reached(doors, locked, power, needed, steps) -> None:
    facts = [f"(door {one} {other})" for one, other in doors] + [f"(locked {name})" for name in locked]
    facts += [f"(= (needed {name}) {number})" for name, number in zip(PLACES, needed)]
    facts += [f"(= (power) {power})"] if power is not None else []
    domain = parse_domain(LAMPS)
    problem = parse_problem(
        f"""(define (problem p) (:domain lamps) (:objects {" ".join(PLACES)} - place)
        (:init (at p0) {" ".join(facts)}) (:goal (and {GOALS})))""",
        domain,
    )
    lasts = dict(zip(PLACES, map(float, needed)))
    plan = [
        PlanStep(10.0 * number, name, tuple(arguments), lasts[arguments[0]] if name == "unlock" else 0.0)
        for number, (name, *arguments) in enumerate(steps, 1)
    ]
    reach = Reachability(domain, problem, time.thread_time() + LONG)
    reach.run()
    for goal in PlanRun(domain, problem, plan).run(falling=True).reached:
        assert reach.state.holds(goal, {}), goal
