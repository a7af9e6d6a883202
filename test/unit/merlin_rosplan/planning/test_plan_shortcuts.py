# SPDX-License-Identifier: Apache-2.0
"""Detours of a plan are left out, as long as it stays valid."""

from pathlib import Path
from typing import List, Tuple

import pytest

from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.plan_text import PlanStep
from merlin_rosplan.planning.plan_shortcuts import PlanShortcuts
from merlin_rosplan.planning.planner import PlannerSettings, Task
from merlin_rosplan.planning.planner_kairos import KairosPlanner

DOMAIN = """(define (domain d) (:requirements :typing :durative-actions :numeric-fluents)
  (:types robot place) (:predicates (at ?r - robot ?p - place) (free ?p - place) (seen ?p - place))
  (:functions (distance ?x ?y - place))
  (:durative-action drive :parameters (?r - robot ?x ?y - place)
    :duration (= ?duration (* 2 (distance ?x ?y)))
    :condition (and (at start (at ?r ?x)) (at start (free ?y)))
    :effect (and (at start (not (at ?r ?x))) (at start (free ?x)) (at start (not (free ?y)))
                 (at end (at ?r ?y))))
  (:durative-action look :parameters (?r - robot ?p - place) :duration (= ?duration 1)
    :condition (over all (at ?r ?p)) :effect (at end (seen ?p))))"""
PROBLEM = """(define (problem p) (:domain d) (:objects ann bob - robot a b c - place)
  (:init (at ann a) (free b) (free c) (at bob b)
    (= (distance a b) 3) (= (distance b a) 3) (= (distance a c) 4) (= (distance c a) 4)
    (= (distance b c) 5) (= (distance c b) 5))
  (:goal (and (seen c))) (:metric minimize (total-time)))"""
WITHOUT_BOB = PROBLEM.replace("(at bob b)", "").replace("ann bob", "ann")


def taken(problem: str, *steps: Tuple[float, str, float]) -> List[Tuple[float, str, float]]:
    plan = []
    for time, text, duration in steps:
        name, *arguments = text.split()
        plan.append(PlanStep(time, name, tuple(arguments), duration))
    validator = PlanValidator(DOMAIN, problem)
    assert validator.fault(plan) is None
    shorter = PlanShortcuts(DOMAIN, problem, validator).taken(plan)
    assert validator.fault(shorter) is None
    return [(step.time, " ".join((step.name, *step.arguments)), step.duration) for step in shorter]


def test_two_drives_become_one_that_goes_there() -> None:
    steps = [(0.0, "drive ann a b", 6.0), (6.1, "drive ann b c", 10.0), (16.2, "look ann c", 1.0)]
    assert taken(WITHOUT_BOB, *steps) == [(0.0, "drive ann a c", 8.0), (16.2, "look ann c", 1.0)]


def test_a_drive_there_and_back_is_left_out() -> None:
    steps = [
        (0.0, "drive ann a b", 6.0),
        (6.1, "drive ann b a", 6.0),
        (12.2, "drive ann a c", 8.0),
        (20.3, "look ann c", 1.0),
    ]
    shorter = taken(WITHOUT_BOB, *steps)
    assert [text for _, text, _ in shorter] == ["drive ann a c", "look ann c"]


def test_where_something_is_done_on_the_way_it_stays() -> None:
    steps = [
        (0.0, "drive ann a b", 6.0),
        (6.1, "look ann b", 1.0),
        (7.2, "drive ann b c", 10.0),
        (17.3, "look ann c", 1.0),
    ]
    problem = WITHOUT_BOB.replace("(seen c)", "(seen b) (seen c)")
    assert taken(problem, *steps) == steps


def test_a_place_that_another_robot_leaves_later_is_driven_to_later() -> None:
    problem = PROBLEM.replace("(at bob b)", "(at bob c) (free d) (= (distance c d) 1)")
    problem = problem.replace("(free c)", "").replace("a b c - place", "a b c d - place")
    steps = [
        (0.0, "drive ann a b", 6.0),
        (5.0, "drive bob c d", 2.0),
        (6.1, "drive ann b c", 10.0),
        (16.2, "look ann c", 1.0),
    ]
    assert taken(problem, *steps) == [
        (5.0, "drive bob c d", 2.0),
        (pytest.approx(8.1), "drive ann a c", 8.0),
        (16.2, "look ann c", 1.0),
    ]


def test_what_the_goal_needs_is_not_a_detour() -> None:
    problem = WITHOUT_BOB.replace("(seen c)", "(at ann b)")
    steps = [(0.0, "drive ann a b", 6.0)]
    assert taken(problem, *steps) == steps


def test_a_detour_that_the_metric_prefers_stays() -> None:
    fuel = DOMAIN.replace("(distance ?x ?y - place)", "(distance ?x ?y - place) (fuel ?x ?y - place) (used)")
    fuel = fuel.replace("(at end (at ?r ?y))", "(at end (at ?r ?y)) (at end (increase (used) (fuel ?x ?y)))")
    problem = WITHOUT_BOB.replace("(distance a b) 3)", "(distance a b) 3) (= (used) 0) (= (fuel a c) 9)", 1)
    problem = problem.replace("(= (used) 0)", "(= (used) 0) (= (fuel a b) 1) (= (fuel b c) 1)")
    problem = problem.replace("minimize (total-time)", "minimize (used)")
    steps = [
        PlanStep(0.0, "drive", ("ann", "a", "b"), 6.0),
        PlanStep(6.1, "drive", ("ann", "b", "c"), 10.0),
        PlanStep(16.2, "look", ("ann", "c"), 1.0),
    ]
    validator = PlanValidator(fuel, problem)
    assert validator.fault(steps) is None
    assert PlanShortcuts(fuel, problem, validator).taken(steps) == steps


@pytest.mark.parametrize("seconds, stopped, drives", [(60.0, False, 1), (0.0, False, 2), (60.0, True, 2)])
def test_shortcuts_are_taken_while_the_planner_may_look(seconds: float, stopped: bool, drives: int) -> None:
    planner = KairosPlanner()
    if stopped:
        planner.stop()
    task = Task(Path("d"), Path("p"), DOMAIN, WITHOUT_BOB, Path("f"), PlannerSettings())
    steps = [
        PlanStep(0.0, "drive", ("ann", "a", "b"), 6.0),
        PlanStep(6.1, "drive", ("ann", "b", "c"), 10.0),
        PlanStep(16.2, "look", ("ann", "c"), 1.0),
    ]
    assert len(planner._direct(task, steps, seconds)) == drives + 1


def test_a_plan_of_a_large_problem_does_not_wait_for_its_shortcuts(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: List[List[PlanStep]] = []
    validator = PlanValidator(DOMAIN, WITHOUT_BOB)
    monkeypatch.setattr(validator, "fault", lambda plan: asked.append(plan) or "no")
    monkeypatch.setattr(validator, "quality", None)  # which validates, too
    steps = [
        PlanStep(0.0, "drive", ("ann", "a", "b"), 6.0),
        PlanStep(6.1, "drive", ("ann", "b", "c"), 10.0),
    ]
    shortcuts = PlanShortcuts(DOMAIN, WITHOUT_BOB, validator)
    assert shortcuts.taken(steps, lambda: not asked) == steps
    assert len(asked) == 1
