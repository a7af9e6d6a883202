# SPDX-License-Identifier: Apache-2.0
"""Trajectory constraints: obeyed from the files to the plan, or refused where they would be lost."""

import pytest

from merlin_pddl.checks.kairos_check import PlanValidator, available, check_input
from merlin_pddl.checks.validate import validate
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.plan_text import parse_plan
from merlin_pddl.problem_reader import parse_condition, parse_problem, read_problem
from merlin_pddl.problem_writer import write_problem
from merlin_pddl.text_reader import PddlError
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.supervised_planning import Planning
from merlin_test import LONG

DOMAIN = """(define (domain rooms)
  (:requirements :typing :durative-actions :negative-preconditions :constraints :preferences)
  (:types room) (:constants kitchen bar - room)
  (:predicates (at ?r - room) (visited ?r - room))
  CONSTRAINTS
  (:durative-action go :parameters (?a ?b - room) :duration (= ?duration 5)
    :condition (at start (at ?a))
    :effect (and (at start (not (at ?a))) (at end (at ?b)) (at end (visited ?b)))))"""
PROBLEM = """(define (problem p) (:domain rooms) (:objects hall - room) (:init (at hall))
  (:goal GOAL) CONSTRAINTS METRIC)"""
DIRECT = "0.0: (go hall bar) [5.0]\n"
SOMETIME = "(:constraints (sometime (at kitchen)))"

needs_kairos = pytest.mark.skipif(not available(), reason="kairos needs Python 3.10")


def domain_text(constraints=""):
    return DOMAIN.replace("CONSTRAINTS", constraints)


def problem_text(constraints="", goal="(at bar)", metric=""):
    return PROBLEM.replace("GOAL", goal).replace("CONSTRAINTS", constraints).replace("METRIC", metric)


@pytest.fixture
def plan(tmp_path):
    def run(domain, problem, command=""):
        (tmp_path / "domain.pddl").write_text(domain)
        (tmp_path / "problem.pddl").write_text(problem)
        settings = PlannerSettings(command=command)
        return Planning(settings, str(tmp_path / "domain.pddl"), str(tmp_path / "problem.pddl")).run()

    return run


@needs_kairos
@pytest.mark.parametrize(
    "domain, problem",
    [(domain_text(), problem_text(SOMETIME)), (domain_text(SOMETIME), problem_text())],
    ids=["problem", "domain"],
)
def test_a_plan_obeys_the_constraints_of_the_files(plan, domain, problem):
    outcome = plan(domain, problem)
    assert [str(step) for step in parse_plan(outcome.plan)] == ["(go hall kitchen)", "(go kitchen bar)"]
    fault = PlanValidator(domain, problem).fault(parse_plan(DIRECT))
    assert fault is not None and ":constraints" in fault


@needs_kairos
def test_a_planner_that_does_not_know_constraints_is_found_out(plan):
    outcome = plan(domain_text(), problem_text(SOMETIME), f"printf '{DIRECT}#' DOMAIN PROBLEM")
    assert outcome.state == PlannerState.INVALID and ":constraints" in outcome.reason


@needs_kairos
def test_a_constraint_that_cannot_be_kept_is_unsolvable(plan):
    outcome = plan(domain_text("(:constraints (always (not (at bar))))"), problem_text())
    assert outcome.state == PlannerState.UNSOLVABLE


@needs_kairos
@pytest.mark.parametrize("goal", ["(and (at bar) (sometime (at kitchen)))", "(always (not (at kitchen)))"])
def test_a_constraint_in_the_goal_is_refused_with_its_place(plan, goal):
    outcome = plan(domain_text(), problem_text(goal=goal))
    assert outcome.state == PlannerState.INVALID
    assert "problem.pddl:2:" in outcome.reason and "(:constraints ...)" in outcome.reason


@needs_kairos
def test_a_predicate_may_have_the_name_of_a_constraint():
    domain = "(define (domain d) (:predicates (within ?x)) (:action a :parameters (?x) :effect (within ?x)))"
    problem = "(define (problem p) (:domain d) (:objects o) (:init) (:goal (within o)))"
    assert check_input(domain, problem, "d", "p") is None


@pytest.mark.parametrize("goal", ["(sometime (at kitchen))", "(and (at bar) (within 5 (at kitchen)))"])
def test_a_goal_of_the_knowledge_base_is_refused_with_what_to_do(goal):
    with pytest.raises(PddlError, match=r"goal:1:\d+: '\S+' is a trajectory constraint.*:constraints"):
        parse_condition(goal, parse_domain(domain_text()), {})


def test_a_knowledge_base_refuses_them_with_their_place(tmp_path):
    path = tmp_path / "problem.pddl"
    path.write_text(problem_text(SOMETIME))
    with pytest.raises(PddlError, match=r"problem.pddl:2:20: a knowledge base keeps .* write them into the"):
        read_problem(path, parse_domain(domain_text()))


@pytest.mark.parametrize(
    "constraint",
    [
        "(always (not (at bar)))",
        "(sometime (at bar))",
        "(at-most-once (at bar))",
        "(sometime-after (at bar) (at kitchen))",
        "(sometime-before (at bar) (at kitchen))",
        "(within 20 (at bar))",
        "(hold-after 3 (not (at bar)))",
        "(hold-during 0 3 (at hall))",
        "(always-within 9 (at hall) (at bar))",
        "(at end (at bar))",
        "(and (always (not (at bar))) (sometime (at kitchen)))",
        "(forall (?r - room) (sometime (visited ?r)))",
        "(preference seen (sometime (visited kitchen)))",
    ],
)
def test_every_form_is_read_and_written(constraint):
    domain = parse_domain(domain_text())
    problem = parse_problem(problem_text(f"(:constraints {constraint})"), domain, constraints=True)
    again = parse_problem(write_problem(problem, domain), domain, constraints=True)
    assert problem.constraints == [constraint] and constraint in again.constraints[0]


@pytest.mark.parametrize(
    "constraint, part",
    [
        ("(sometimes (at bar))", "expected a constraint"),
        ("(and (sometimes (at bar)) (sometime (at bar)))", "expected a constraint"),
        ("(and (sometime (at bar)) (sometimes (at bar)))", "expected a constraint"),
        ("(sometime (att bar))", "did you mean 'at'"),
        ("(sometime (at bra))", "did you mean 'bar'"),
        ("(within (at bar))", "takes 1 number"),
        ("(within soon (at bar))", "a time in s"),
        ("(within -1 (at bar))", "a time in s"),
        ("(always)", "takes 1 condition"),
        ("always", "in parentheses"),
    ],
)
def test_a_constraint_that_makes_no_sense_is_refused(constraint, part):
    with pytest.raises(PddlError, match=r"problem:2:\d+: ") as caught:
        parse_problem(
            problem_text(f"(:constraints {constraint})"), parse_domain(domain_text()), constraints=True
        )
    assert part in str(caught.value)


@needs_kairos
def test_a_preference_counts_in_the_metric(plan):
    soft = "(:constraints (preference seen (sometime (visited kitchen))))"
    metric = "(:metric minimize (+ (total-time) (* 100 (is-violated seen))))"
    outcome = plan(domain_text(), problem_text(soft, metric=metric))
    assert "(go kitchen bar)" in outcome.plan
    direct = PlanValidator(domain_text(), problem_text(soft, metric=metric))
    assert direct.fault(parse_plan(DIRECT)) is None
    assert direct.quality(parse_plan(DIRECT)).metric == 105.0
    assert direct.quality(parse_plan(outcome.plan)).metric < 20.0


@needs_kairos
def test_validate_plans_with_constraints_and_another_goal(tmp_path, capsys):
    domain, problem = tmp_path / "domain.pddl", tmp_path / "problem.pddl"
    domain.write_text(domain_text())
    problem.write_text(problem_text(SOMETIME))
    assert validate([str(domain), str(problem), "(visited bar)", "--time-limit", str(LONG)]) == 0
    assert "(go hall kitchen)" in capsys.readouterr().out


OBJECTS = """(define (domain o) (:requirements :typing :object-fluents :negative-preconditions) (:types place)
  (:predicates (seen ?p - place)) (:functions (where) - place)
  (:action go :parameters (?b - place) :precondition (not (= (where) ?b))
    :effect (and (assign (where) ?b) (seen ?b))))"""


def test_functions_of_objects_are_refused_where_messages_cannot_carry_them():
    with pytest.raises(PddlError, match=r"domain:2:\d+: .*carry no object as a value; use a predicate"):
        parse_domain(OBJECTS)


@needs_kairos
def test_files_with_functions_of_objects_are_planned_for(plan):
    problem = "(define (problem p) (:domain o) (:objects a b - place) (:init (= (where) a)) (:goal (seen b)))"
    outcome = plan(OBJECTS, problem)
    assert outcome.solved and "(go b)" in outcome.plan


def test_a_domain_knows_what_its_constraints_read():
    domain = parse_domain(
        domain_text(
            """(:constraints (and (forall (?r - room) (sometime-before (at ?r) (visited kitchen)))
            (at end (and (visited bar) (at bar)))
            (preference p (always (exists (?r - room) (not (at ?r)))))))"""
        )
    )
    assert domain.constraints[0] == {("at", "?r"), ("visited", "kitchen")}
    assert set(domain.constraints[1:3]) == {frozenset({("visited", "bar")}), frozenset({("at", "bar")})}
    assert domain.constraints[3:] == (frozenset({("at", "")}),)
