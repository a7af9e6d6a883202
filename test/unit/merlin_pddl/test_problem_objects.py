# SPDX-License-Identifier: Apache-2.0
"""What a problem says of its objects: their types, each declared once, and other facts of them."""

import pytest

from merlin_pddl.analysis.demand import demand
from merlin_pddl.analysis.plan_run import plan_fault
from merlin_pddl.checks.portability import declared_twice
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.plan_text import PlanStep
from merlin_pddl.problem_reader import parse_condition, parse_problem
from merlin_pddl.text_reader import PddlError

DOMAIN = parse_domain("""(define (domain d)
    (:requirements :typing) (:types place item - object room - place)
    (:predicates (at ?p - place) (ordered ?i - item ?r - room)) (:functions (battery))
    (:action tidy :parameters (?p - place ?i - item) :precondition (ordered ?i ?p) :effect (at ?p)))""")


def problem(objects, init):
    return f"(define (problem p) (:domain d)\n(:objects\n{objects})\n(:init {init}))"


def test_an_object_of_a_wider_type_is_refused_where_a_variable_may_stand():
    objects = "lobby - place suite - room towel - item"
    assert parse_problem(problem(objects, "(ordered towel suite) (at suite)"), DOMAIN).facts
    with pytest.raises(PddlError, match="4:23: 'lobby' is of type place, but 'ordered' takes room"):
        parse_problem(problem(objects, "(ordered towel lobby)"), DOMAIN)


def test_an_object_with_two_types_is_of_both():
    objects = "lobby - place lobby - room towel - item"
    assert parse_problem(problem(objects, "(ordered towel lobby)"), DOMAIN).facts


def test_an_object_that_is_a_constant_too_has_the_types_of_both():
    text = """(define (domain d) (:types room item) (:constants box - item) (:predicates (in ?r - room)
        (used ?i - item)) (:action use :parameters (?i - item) :effect (used ?i))
        (:action enter :parameters (?r - room) :effect (in ?r)))"""
    domain = parse_domain(text)
    goals = "(:goal (and (forall (?i - item) (used ?i)) (forall (?r - room) (in ?r))))"
    found = parse_problem(f"(define (problem p) (:domain d) (:objects Box - room) {goals})", domain)
    assert found.typed(domain.constants) == {"box": ("item", "room")}
    steps = [PlanStep(0.0, "use", ("box",)), PlanStep(0.001, "enter", ("box",))]
    assert plan_fault(domain, found, steps) == ""
    assert plan_fault(domain, found, steps[1:]) == "(forall (?i - item) (used ?i)) does not hold"
    assert demand(text, found.objects, ["(use box)", "(enter box)"])[1]


def test_objects_that_are_declared_twice_are_named():
    text = problem("lobby - (either place item)\ntowel lobby\n - item\nroom_1 place - room", "(at lobby)")
    (twice,) = declared_twice(text, "p.pddl")
    assert twice.startswith("p.pddl:4:7: warning: 'lobby' is declared in line 3 already")


def test_a_copy_has_other_facts_and_values_at_its_start():
    before = parse_problem(problem("lobby hall - place", "(at lobby) (= (battery) 5)"), DOMAIN)
    objects = before.typed(DOMAIN.constants)

    def after(*changes):
        found = before.changed([parse_condition(change, DOMAIN, objects) for change in changes])
        return [fact.text() for fact in found.facts], [value.value for value in found.values]

    assert after("(not (at lobby))", "(at hall)", "(= (battery) 20)") == (["(at hall)"], [20.0])
    assert after("(not (at hall))") == after() == (["(at lobby)"], [5.0])
    with pytest.raises(ValueError, match=r"\(> \(battery\) 3\) sets neither a fact nor a value"):
        after("(> (battery) 3)")
