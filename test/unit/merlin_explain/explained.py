# SPDX-License-Identifier: Apache-2.0
"""Tasks and plans that the tests of answers share."""

from pathlib import Path

import kairos

from merlin_explain.core.causes import Causes
from merlin_explain.core.judge import Judge
from merlin_explain.core.other_plan import Found
from merlin_pddl.plan_text import parse_plan

ROOT = Path(__file__).resolve().parents[3]

COURIER = """(define (domain courier)
  (:requirements :typing :negative-preconditions :durative-actions :numeric-fluents)
  (:types place box)
  (:predicates (at ?p - place) (in ?b - box ?p - place) (held ?b - box) (door ?from ?to - place)
    (lit ?p - place))
  (:functions (battery))
  (:durative-action drive :parameters (?from ?to - place) :duration (= ?duration 10)
    :condition (and (at start (at ?from)) (over all (door ?from ?to)) (at start (>= (battery) 5)))
    :effect (and (at start (not (at ?from))) (at end (at ?to)) (at end (decrease (battery) 2))))
  (:durative-action load :parameters (?b - box ?p - place) :duration (= ?duration 3)
    :condition (and (over all (at ?p)) (at start (in ?b ?p)))
    :effect (and (at start (not (in ?b ?p))) (at end (held ?b))))
  (:durative-action unload :parameters (?b - box ?p - place) :duration (= ?duration 3)
    :condition (and (over all (at ?p)) (at start (held ?b)))
    :effect (and (at start (not (held ?b))) (at end (in ?b ?p))))
  (:durative-action light :parameters (?p - place) :duration (= ?duration 1)
    :condition (over all (at ?p)) :effect (at end (lit ?p))))"""
DOORS = "(door hall ward) (door ward hall) (door hall yard) (door yard ward)"
INIT = f"(at hall) (in box_1 hall) {DOORS} (= (battery) 40)"
PLAN = """0.000: (load box_1 hall) [3.000]
3.001: (drive hall ward) [10.000]
13.002: (unload box_1 ward) [3.000]"""


def courier_problem(goal="(in box_1 ward)", init=INIT):
    return f"""(define (problem day) (:domain courier)
      (:objects hall ward yard roof - place box_1 box_2 - box)
      (:init {init}) (:goal (and {goal})) (:metric minimize (total-time)))"""


def courier(goal="(in box_1 ward)", plan=PLAN, init=INIT):
    return Causes(Judge(COURIER, courier_problem(goal, init)), parse_plan(plan))


def solved(domain, problem, seconds=5.0):
    """What kairos finds."""
    result = kairos.solve(domain, problem, timeout=seconds)
    if result.status != kairos.Status.SOLVED:
        return Found(None, problem, "the planner found none", 0.1)
    return Found(parse_plan(str(result.plan)), problem, "", 0.1)
