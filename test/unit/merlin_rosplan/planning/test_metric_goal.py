# SPDX-License-Identifier: Apache-2.0
"""Metrics that kairos does not follow: a better plan is asked for as a goal."""

import pytest

from merlin_rosplan.planning.metric_goal import MetricGoal
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.supervised_planning import Planning

HEAD = "(define (problem p) (:domain d) (:objects A - item) (:init (= (worth) 0))"
KNAPSACK = """(define (domain sack) (:requirements :typing :numeric-fluents) (:types item)
  (:predicates (out ?i - item) (closed))
  (:functions (room) (worth) (waste) (size ?i - item) (value ?i - item))
  (:action pack :parameters (?i - item) :precondition (and (out ?i) (>= (room) (size ?i)))
    :effect (and (not (out ?i)) (decrease (room) (size ?i)) (increase (worth) (value ?i))
                 (decrease (waste) (size ?i))))
  (:action close :parameters () :effect (closed)))"""
ITEMS = {"Cup": (2, 3), "Jar": (3, 4), "Box": (4, 5), "Bag": (5, 6)}


@pytest.mark.parametrize(
    "metric, value, by, condition",
    [
        ("maximize (worth)", 3.0, 0.0, "(>= (worth) 3.000100)"),
        ("maximize (worth)", 3.0, 2.5, "(>= (worth) 5.500000)"),
        ("MINIMIZE (+ (Worth) (* 2 (waste)))", 3.0, 0.0, "(<= (+ (worth) (* 2 (waste))) 2.999900)"),
        ("maximize (worth)", -3.0, 0.0, "(>= (worth) (- 2.999900))"),
        ("maximize (total-cost)", 1.0, 0.0, "(>= (total-cost) 1.000100)"),
    ],
)
def test_a_better_plan_is_a_goal(metric, value, by, condition):
    goal = MetricGoal.of(f"{HEAD} (:goal (closed)) (:metric {metric}))")
    text = goal.better_than(value, by)
    assert text.endswith(f"(:goal (and (closed) {condition})))") and "(:objects a - item)" in text


@pytest.mark.parametrize(
    "rest",
    [
        "(:goal (closed)))",
        "(:goal (closed)) (:metric minimize (total-cost)))",
        "(:goal (closed)) (:metric minimize ( Total-Time)))",
        "(:goal (closed)) (:metric minimize (+ (total-time) (waste))))",
        "(:goal (preference p (closed))) (:metric minimize (is-violated p)))",
        "(:metric maximize (worth)))",
        "(:goal (closed)) (:metric maximize (worth))",
        "(:goal (closed)) (:metric maximize))",
    ],
)
def test_other_metrics_are_left_to_the_planner(rest):
    assert MetricGoal.of(f"{HEAD} {rest}") is None


@pytest.mark.parametrize("metric, left", [("maximize (worth)", {"Bag", "Box"}), ("minimize (waste)", None)])
def test_kairos_finds_the_best_value(tmp_path, metric, left):
    pytest.importorskip("kairos")
    init = " ".join(f"(out {i}) (= (size {i}) {s}) (= (value {i}) {v})" for i, (s, v) in ITEMS.items())
    (tmp_path / "domain.pddl").write_text(KNAPSACK)
    (tmp_path / "problem.pddl").write_text(
        f"(define (problem p) (:domain sack) (:objects {' '.join(ITEMS)} - item) (:init (= (room) 5) "
        f"(= (worth) 0) (= (waste) 5) {init}) (:goal (closed)) (:metric {metric}))"
    )
    # The proof that nothing is better ends it, long before the time is over.
    settings = PlannerSettings(anytime=60.0, time_limit=120.0)
    outcome = Planning(settings, str(tmp_path / "domain.pddl"), str(tmp_path / "problem.pddl")).run()
    assert outcome.state == PlannerState.SOLVED, outcome
    packed = {name for name in ITEMS if f"(pack {name})" in outcome.plan}  # as the problem spells them
    assert sum(ITEMS[name][0] for name in packed) == 5
    if left is not None:
        assert packed == set(ITEMS) - left
