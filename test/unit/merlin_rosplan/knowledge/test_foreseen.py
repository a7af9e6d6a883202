# SPDX-License-Identifier: Apache-2.0
"""The state that is expected when what runs has ended."""

from pathlib import Path
from typing import Set

import pytest

from merlin_pddl.domain_reader import parse_domain, read_domain
from merlin_pddl.problem import Problem
from merlin_pddl.problem_reader import parse_problem, read_problem
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.knowledge.foreseen import after_actions, with_facts
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused

HOME = Path(__file__).resolve().parents[4] / "pddl" / "home"
NUMBERS = """(define (domain d) (:requirements :typing :durative-actions :numeric-fluents)
  (:types place) (:predicates (in ?p - place) (wet ?p - place) (clean ?p - place))
  (:functions (battery) (way ?p - place))
  (:durative-action drive :parameters (?p - place) :duration (= ?duration (way ?p))
    :condition (at start (>= (battery) 1))
    :effect (and (at end (in ?p)) (at end (decrease (battery) (way ?p)))
      (when (at end (wet ?p)) (at end (not (clean ?p)))))))"""

LASTING = """(define (domain d) (:requirements :durative-actions :numeric-fluents)
  (:predicates (lit)) (:functions (battery) (heat) (lamps))
  (:durative-action charge :parameters () :duration (= ?duration 10) :condition ()
    :effect (and (at end (increase (battery) ?duration)) (increase (heat) (* #t 2))))
  (:action light :parameters () :precondition () :effect (and (lit) (increase (lamps) 1))))"""

OPEN = """(define (domain d) (:requirements :durative-actions :duration-inequalities :numeric-fluents)
  (:predicates (done)) (:functions (battery))
  (:durative-action charge :parameters () :duration (and (>= ?duration 5) (<= ?duration 20))
    :effect (and EFFECT (at end (done)))))"""


def facts_of(problem: Problem) -> Set[str]:
    return {fact.text() for fact in problem.facts}


def test_a_robot_on_its_way_is_where_it_goes() -> None:
    domain = read_domain(HOME / "domain.pddl")
    problem = read_problem(HOME / "problem.pddl", domain)
    problem.facts = [fact for fact in problem.facts if fact.name != "robot_at"]  # it has left
    before = facts_of(problem)
    after = after_actions(domain, problem, ["(navigate anywhere kitchen)"])
    assert facts_of(after) - before == {"(robot_at kitchen)"} and before <= facts_of(after)
    assert after.objects == problem.objects and len(after.values) == len(problem.values)
    assert facts_of(problem) == before, "the caller's stays as it is"
    assert facts_of(after_actions(domain, problem, ["(navigate anywhere kitchen)", "(ask kitchen)"])) >= {
        "(checked kitchen)"
    }


def test_what_follows_begins_first() -> None:
    domain = read_domain(HOME / "domain.pddl")
    problem = read_problem(HOME / "problem.pddl", domain)
    problem.facts = [fact for fact in problem.facts if fact.name != "robot_at"]
    then = ["(navigate kitchen bathroom)", "(ask bathroom)"]
    after = facts_of(after_actions(domain, problem, ["(navigate anywhere kitchen)"], then))
    assert {"(robot_at bathroom)", "(checked bathroom)"} <= after and "(robot_at kitchen)" not in after


def test_an_effect_that_depends_on_the_start_of_what_follows_sees_the_state_before_it() -> None:
    domain = parse_domain(
        """(define (domain d) (:predicates (closed) (opened)) (:durative-action open :parameters ()
          :duration (= ?duration 1) :effect (and (at start (not (closed)))
            (when (at start (closed)) (at end (opened))))))"""
    )
    problem = parse_problem("(define (problem p) (:domain d) (:init (closed)) (:goal (opened)))", domain)
    assert facts_of(after_actions(domain, problem, [], ["(open)"])) == {"(opened)"}


def test_numbers_and_conditional_effects_count() -> None:
    domain = parse_domain(NUMBERS)
    text = """(define (problem p) (:domain d) (:objects a b - place)
      (:init (wet a) (clean a) (clean b) (= (battery) 50) (= (way a) 7) (= (way b) 3)) (:goal (in a)))"""
    after = after_actions(domain, parse_problem(text, domain), ["(drive A)", "(drive b)"])
    assert facts_of(after) == {"(wet a)", "(clean b)", "(in a)", "(in b)"}
    assert {value.text(): value.value for value in after.values}["(battery)"] == 40.0


def test_what_an_action_changes_while_it_lasts_counts_as_long_as_it_lasts() -> None:
    domain = parse_domain(LASTING)
    problem = parse_problem(
        "(define (problem p) (:domain d) (:init (= (battery) 50) (= (heat) 20) (= (lamps) 0)) (:goal (lit)))",
        domain,
    )
    after = after_actions(domain, problem, ["(charge)", "(light)"], ["(light)"])
    values = {value.text(): value.value for value in after.values}
    # A plain action that runs has changed nothing yet.
    assert values == {"(battery)": 60.0, "(heat)": 40.0, "(lamps)": 2.0}


@pytest.mark.parametrize(
    ("action", "why"),
    [
        ("(fly kitchen)", "unknown operator 'fly'"),
        ("(ask moon)", "unknown object 'moon'"),
        ("(ask)", "has not the parameters"),
        ("", "unknown operator"),
    ],
)
def test_what_cannot_be_foreseen_is_said(action: str, why: str) -> None:
    domain = read_domain(HOME / "domain.pddl")
    with pytest.raises(UpdateRefused, match=why):
        after_actions(domain, read_problem(HOME / "problem.pddl", domain), [action])


@pytest.mark.parametrize(
    ("effect", "names"),
    [("(increase (battery) (* #t 0.1))", "#t"), ("(at end (increase (battery) ?duration))", "?duration")],
)
def test_a_duration_that_is_open_is_named_where_an_effect_needs_it(effect: str, names: str) -> None:
    domain = parse_domain(OPEN.replace("EFFECT", effect))
    problem = parse_problem("(define (problem p) (:domain d) (:init (= (battery) 1)) (:goal (done)))", domain)
    with pytest.raises(UpdateRefused) as refused:
        after_actions(domain, problem, ["(charge)"])
    assert str(refused.value) == (
        f"the effect of 'charge' on (battery) has no number: {names} is not known, "
        "as its :duration has no '='; write (= ?duration …)"
    )


def test_other_facts_and_values_take_the_place_of_those_that_are() -> None:
    domain = parse_domain(NUMBERS)
    text = """(define (problem p) (:domain d) (:objects a b - place)
      (:init (wet A) (= (battery) 50) (= (way a) 7)) (:goal (in a)))"""
    problem = parse_problem(text, domain)
    changes = ["(not (wet a))", "(and (in b) (= (battery) 4))", "(= (way b) 2)", "(in B)"]
    with_facts(domain, problem, changes)
    assert facts_of(problem) == {"(in b)"}
    assert {value.text(): value.value for value in problem.values} == {
        "(battery)": 4.0,
        "(way a)": 7.0,
        "(way b)": 2.0,
    }


@pytest.mark.parametrize(
    "text",
    [
        "(in moon)",
        "(flies a)",
        "(in a",
        "(> (battery) 3)",
        "(or (in a) (in b))",
        "",
        "()",
        "(and)",
        "(and (in a) (not (in A)))",
        "(and (= (battery) 3) (= (battery) 4))",
    ],
)
def test_what_is_no_fact_is_said(text: str) -> None:
    domain = parse_domain(NUMBERS)
    problem = parse_problem(
        "(define (problem p) (:domain d) (:objects a b - place) (:init) (:goal (in a)))", domain
    )
    with pytest.raises((PddlError, UpdateRefused)):
        with_facts(domain, problem, [text])
    assert not problem.facts
