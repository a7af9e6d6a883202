# SPDX-License-Identifier: Apache-2.0
"""Random domains, plans of kairos and random changes: the watch and the validator of plans say the same."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rest_world import RestWorld

from merlin_pddl.plan_text import NO_DURATION
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule, SequentialSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction

kairos = pytest.importorskip("kairos")
FACTS = [f"f{number}" for number in range(6)]
OPERATORS = 7
EXAMPLES = settings(max_examples=25, deadline=None, derandomize=True, database=None)


class InTime(SequentialSchedule):
    """The happenings as they are planned, some at once."""

    def happenings(self):
        return GraphSchedule.happenings(self)


def literals(rng, least, most):
    found = rng.sample(FACTS, rng.randint(least, most))
    return [f"({fact})" if rng.random() < 0.7 else f"(not ({fact}))" for fact in found]


def plain(rng, number, more=""):
    needed, changed = literals(rng, 0, 2), literals(rng, 1, 3)
    return (
        f"(:action o{number} :parameters () :precondition (and {' '.join(needed)}) "
        f":effect (and {' '.join(changed)} {more}))"
    )


def durative(rng, number):
    needed = [f"({rng.choice(['at start', 'over all', 'at end'])} {each})" for each in literals(rng, 0, 3)]
    changed = [f"({rng.choice(['at start', 'at end'])} {each})" for each in literals(rng, 1, 3)]
    return (
        f"(:durative-action o{number} :parameters () :duration (= ?duration {rng.randint(1, 4)}) "
        f":condition (and {' '.join(needed)}) :effect (and {' '.join(changed)}))"
    )


def adl(rng, number):
    """Something that is not followed exactly, now and then."""
    more = [f"(when {literals(rng, 1, 1)[0]} {literals(rng, 1, 1)[0]})", "(increase (n) 1)", ""]
    text = plain(rng, number, rng.choice(more))
    if rng.random() < 0.4:
        first, second = literals(rng, 2, 2)
        extra = rng.choice([f"(or {first} {second})", "(>= (n) 1)", "(< (n) 2)"])
        text = text.replace(":precondition (and", f":precondition (and {extra}")
    return text


def solved(seed, operator):
    """A world with a plan of two actions and more."""
    for number in range(100):
        rng = random.Random(f"{seed} {number}")
        world = _solved(rng, operator)
        if world is not None:
            return rng, world
    raise AssertionError(f"no domain of {seed} has a plan")


def _solved(rng, operator):
    domain = (
        "(define (domain d) (:requirements :adl :durative-actions :numeric-fluents)"
        f"(:predicates {' '.join(f'({fact})' for fact in FACTS)}) (:functions (n)) "
        + " ".join(operator(rng, number) for number in range(OPERATORS))
        + ")"
    )
    init = " ".join(f"({fact})" for fact in FACTS if rng.random() < 0.4)
    goal = " ".join(literals(rng, 2, 3))
    problem = f"(define (problem p) (:domain d) (:init {init} (= (n) 0)) (:goal (and {goal})))"
    plan = kairos.solve(domain, problem, timeout=2.0).plan
    if plan is None or len(plan.steps) < 2:
        return None
    steps = [
        PlannedAction(
            number, step.name, (), step.duration if operator is durative else NO_DURATION, step.time
        )
        for number, step in enumerate(plan.steps)
    ]
    if operator is not durative:
        steps = [PlannedAction(each.id, each.name, (), NO_DURATION, float(each.id)) for each in steps]
    return RestWorld(domain, problem, steps, InTime(steps) if operator is durative else None)


def change(rng, world):
    for _ in range(rng.randint(1, 2)):
        fact = rng.choice(FACTS)
        holds = f"({fact})" in {row.text() for row in world.store.facts()}
        world.make(f"(not ({fact}))" if holds else f"({fact})")


def advance(rng, world):
    """Some actions end, and one may run; returns the ids of what waits, and what runs."""
    done = rng.randrange(len(world.actions))
    for number in range(done):
        world.start(number)
        world.end(number)
    running = []
    if rng.random() < 0.5:
        world.start(done)
        running = [world.actions[done]]
    return list(range(done + len(running), len(world.actions))), running


def judged(world, waiting, running):
    """What the watch says, and what the validator says against the rest that the watch leaves."""
    verdict = world.watch.look()
    left = [world.actions[number] for number in waiting if number not in world.watch.skipped]
    return verdict, world.fault(left, running)


@given(st.integers(0, 10**6))
@EXAMPLES
def test_a_plan_is_given_up_exactly_when_its_rest_is_not_valid(seed):
    rng, world = solved(seed, plain)
    waiting, running = advance(rng, world)
    assert judged(world, waiting, running) == (None, None)
    for _ in range(3):
        change(rng, world)
        verdict, fault = judged(world, waiting, running)
        if verdict is not None and verdict.achieved:
            assert world.goals_hold()
            return
        assert (verdict is None) == (fault is None), (seed, verdict, fault, world.watch.skipped)
        if verdict is not None:
            return


@given(st.integers(0, 10**6))
@EXAMPLES
def test_so_is_one_with_durations_and_conditions_at_all_times(seed):
    rng, world = solved(seed, durative)
    waiting = list(range(len(world.actions)))
    change(rng, world)
    verdict, fault = judged(world, waiting, [])
    if verdict is None or not verdict.achieved:
        assert (verdict is None) == (fault is None), (seed, verdict, fault, world.watch.skipped)


@given(st.integers(0, 10**6))
@EXAMPLES
def test_no_valid_plan_is_given_up_for_what_cannot_be_followed(seed):
    rng, world = solved(seed, adl)
    waiting, running = advance(rng, world)
    assert world.watch.look() is None
    change(rng, world)
    verdict, fault = judged(world, waiting, running)
    if verdict is not None and not verdict.achieved:
        assert fault is not None, (seed, verdict)
    elif world.watch.skipped:
        assert fault is None, (seed, world.watch.skipped)
