# SPDX-License-Identifier: Apache-2.0
"""Tasks with time windows, what kairos finds for deadlines in them, and an oracle for when goals hold."""

import pytest

from merlin_pddl.analysis.deadlines import DeadlineTask
from merlin_pddl.checks.kairos_check import PlanValidator, check_input
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.evaluation import Evaluator, WorldState
from merlin_pddl.formula import END, ground
from merlin_pddl.knowledge import Fact
from merlin_pddl.plan_text import NO_DURATION, PlanStep
from merlin_pddl.problem_reader import parse_condition, parse_problem
from merlin_pddl.problem_writer import write_problem

kairos = pytest.importorskip("kairos")
LIMIT = 60.0  # s; what is there is found, and what is proven is, in a fraction of a second
SEARCH = 0.5  # s for what is not there: kairos proves only that goals are late one by one, and searches on
SLACK = 0.05  # s: separations of a plan, of 0.001 s each
# After the description of the benchmark with time windows of the competition of 2004: images are sent to the
# ground while an antenna is seen.
SATELLITE = """(define (domain satellite)
  (:requirements :typing :durative-actions :timed-initial-literals)
  (:types satellite direction antenna)
  (:predicates (pointing ?s - satellite ?d - direction) (image ?d - direction) (ready ?s - satellite)
    (visible ?a - antenna) (sent ?d - direction) (free ?a - antenna))
  (:durative-action turn :parameters (?s - satellite ?from ?to - direction) :duration (= ?duration 5)
    :condition (and (at start (pointing ?s ?from)) (over all (ready ?s)))
    :effect (and (at start (not (pointing ?s ?from))) (at end (pointing ?s ?to))))
  (:durative-action take :parameters (?s - satellite ?d - direction) :duration (= ?duration 7)
    :condition (and (at start (ready ?s)) (over all (pointing ?s ?d)))
    :effect (at end (image ?d)))
  (:durative-action send :parameters (?a - antenna ?d - direction) :duration (= ?duration 4)
    :condition (and (at start (image ?d)) (at start (free ?a)) (over all (visible ?a)))
    :effect (and (at start (not (free ?a))) (at end (free ?a)) (at end (sent ?d)))))"""
SKY = """(define (problem night) (:domain satellite)
  (:objects Sat1 - satellite star moon sun - direction dish - antenna)
  (:init (pointing Sat1 sun) (ready Sat1) (free dish) (at 20 (visible dish)) (at 27 (not (visible dish)))
    (at 60 (visible dish)) (at 90 (not (visible dish))))
  (:goal (sent star)))"""

# Likewise of the one with airports: a runway is closed while planes land at known times.
AIRPORT = """(define (domain airport)
  (:requirements :typing :durative-actions :timed-initial-literals)
  (:types plane)
  (:predicates (parked ?p - plane) (on_runway ?p - plane) (vacant) (open) (airborne ?p - plane))
  (:durative-action taxi :parameters (?p - plane) :duration (= ?duration 10)
    :condition (and (at start (parked ?p)) (at start (vacant)))
    :effect (and (at start (not (vacant))) (at start (not (parked ?p))) (at end (on_runway ?p))))
  (:durative-action take_off :parameters (?p - plane) :duration (= ?duration 5)
    :condition (and (at start (on_runway ?p)) (over all (open)))
    :effect (and (at start (not (on_runway ?p))) (at end (airborne ?p)) (at end (vacant)))))"""
MORNING = """(define (problem morning) (:domain airport) (:objects first second - plane)
  (:init (parked first) (parked second) (vacant) (open) (at 12 (not (open))) (at 20 (open)))
  (:goal (and (airborne first) (airborne second))))"""


def solved(domain, problem, dues, binding=True, limit=LIMIT):
    """The state of kairos, and the plan without marks with the times of the goals; None without a plan."""
    task = DeadlineTask(domain, problem, dues, binding)
    assert check_input(task.domain, task.problem, "domain", "problem") is None
    result = kairos.solve(task.domain, task.problem, timeout=limit, anytime=False)
    if result.plan is None:
        return result.status.name, None
    steps = [
        PlanStep(float(step.time), step.name, tuple(step.args), step.duration or NO_DURATION)
        for step in result.plan.steps
    ]
    validator = PlanValidator(task.domain, task.problem)
    assert validator.fault(steps) is None
    found = task.unmarked(steps, validator.fault)
    assert not any(step.name.startswith("collect") for step in found.steps)
    in_time(domain, problem, dues if binding else [due._replace(within=1e6) for due in dues], found)
    return result.status.name, found


class World(WorldState):
    """The task as it was, carried out as it is planned: the oracle for when goals hold."""

    def __init__(self, model, problem, steps):
        self.model = model
        self.problem = parse_problem(problem, model)
        self.facts = {fact.key for fact in self.problem.facts}
        self.values = {value.key: value.value for value in self.problem.values}
        self.happenings = [(row.at / 1e9, row.item, {}) for row in self.problem.timed]
        for step in steps:
            operator = model.operators[step.name]
            bindings = {p.name: value.lower() for p, value in zip(operator.parameters, step.arguments)}
            for effect in operator.effects:
                at_end = effect.when == END and operator.durative
                self.happenings.append((step.time + step.duration * at_end, effect, bindings))
        self.happenings.sort(key=lambda happening: happening[0])

    def holds(self, key):
        return tuple(key) in self.facts

    def value(self, key):
        return self.values.get(tuple(key))

    def objects(self, types):
        return list(self.problem.objects)

    def first(self, goals):
        """When goals hold first."""
        objects = {**self.model.constants, **self.problem.objects}
        wanted = [parse_condition(goal, self.model, objects) for goal in goals]
        evaluator = Evaluator(self.model, self)
        times = [0.0, *dict.fromkeys(time for time, _, _ in self.happenings)]
        for time in times:
            for at, effect, bindings in self.happenings:
                if at == time:
                    self._apply(effect, bindings)
            if all(evaluator.holds(goal, {}) for goal in wanted):
                return time
        raise AssertionError(f"{goals} never hold")

    def _apply(self, effect, bindings):
        if isinstance(effect, Fact):
            key, negative = effect.key, effect.negative
        elif effect.fluent is not None:
            key = (effect.fluent.name, *effect.fluent.args)
            self.values[key] += 1
            return
        else:
            atom = ground(effect.atom, bindings)
            key, negative = (atom.name, *atom.args), effect.negative
        (self.facts.discard if negative else self.facts.add)(key)


def in_time(domain, problem, dues, found):
    """Checks against the task as it was: the plan itself, and when the goals hold."""
    model = parse_domain(domain)
    assert (
        PlanValidator(domain, write_problem(parse_problem(problem, model), model)).fault(found.steps) is None
    )
    for due, time in zip(dues, found.reached):
        assert time == pytest.approx(World(model, problem, found.steps).first(due.goals), abs=0.002)
        assert time <= due.within + SLACK
