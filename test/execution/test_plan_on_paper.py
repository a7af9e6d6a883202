# SPDX-License-Identifier: Apache-2.0
"""A plan on paper, whole or without a step, against PDDL 2.1; and nothing untrue is said of its steps."""

import random
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pddl21 import parse
from random_plans import FACTS, random_plan
from semantics import judge, planned_events, validate

from merlin_explain.claims import Words
from merlin_explain.core.causes import Causes
from merlin_explain.core.judge import Judge
from merlin_explain.core.why import Doing, why
from merlin_pddl.analysis.plan_run import GOAL, PlanRun, plan_fault
from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import to_pddl
from merlin_pddl.problem_reader import parse_problem

SEEDS = st.integers(0, 2**32)
search = settings(max_examples=150, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))


class Task(NamedTuple):
    """A random plan, its model by the standard, and its PDDL."""

    plan: object
    model: object
    domain: str
    problem: str


def task(seed, timed=False, epsilon=0.001):
    """A plan whose goals are some of the facts that it reaches; epsilon as in random_plan."""
    rng = random.Random(seed)
    plan = random_plan(rng, rng.randint(2, 7), False, timed, epsilon)
    model = plan.model
    end = final(model, plan.steps)
    goals = [f"({fact})" for fact in FACTS if (fact,) in end.facts and rng.random() < 0.7] or ["(and)"]
    model.goal = ["and", *([goal.strip("()")] for goal in goals if goal != "(and)")]
    domain = f"(define (domain d) (:requirements :adl :durative-actions) {plan.sections})"
    init = f"(:init {plan.init} {plan.timed})"
    problem = f"(define (problem p) (:domain d) {init} (:goal (and {' '.join(goals)})))"
    return Task(plan, model, domain, problem)


def ground(model, steps):
    return [model.ground(step.name, ()) for step in steps]


def times(steps):
    return [(step.time, step.duration) for step in steps]


def final(model, steps):
    return validate(model, ground(model, steps), times(steps)).state


def right(one, steps):
    """Whether the standard accepts a plan: each condition, and the goals."""
    actions = ground(one.model, steps)
    verdict = judge(one.model, actions, planned_events(one.model, actions, times(steps)), together=True)
    return not verdict.fault and one.model.holds(one.model.goal, verdict.state)


@pytest.mark.parametrize("timed", [False, True])
@search
@given(SEEDS)
def test_a_plan_on_paper_is_that_of_the_standard(timed, seed):
    one = task(seed, timed)
    domain = parse_domain(one.domain)
    run = PlanRun(domain, parse_problem(one.problem, domain), one.plan.steps)
    whole = run.run()
    assert not whole.unmet, (one.plan.text, whole.unmet)
    assert whole.state.facts == final(one.model, one.plan.steps).facts, one.plan.text
    for number in range(len(one.plan.steps)):
        rest = [step for each, step in enumerate(one.plan.steps) if each != number]
        assert (not run.run({number}).unmet) == right(one, rest), (seed, number, one.plan.text)


@pytest.mark.parametrize("timed", [False, True])
@search
@given(SEEDS)
def test_the_validator_of_kairos_says_the_same(timed, seed):
    """Also of plans in which what disturbs each other meets at one moment."""
    one = task(seed, timed, epsilon=0.0)
    domain = parse_domain(one.domain)
    problem = parse_problem(one.problem, domain)
    validator = PlanValidator(one.domain, one.problem)
    steps = one.plan.steps
    for plan in (steps, steps[1:], steps[:-1]):
        ours, theirs = plan_fault(domain, problem, plan), validator.fault(plan)
        assert ours or not theirs, (seed, theirs, one.plan.text)
        # kairos leaves out what is never false, and so sees less that meets.
        meets = validate(one.model, ground(one.model, plan), times(plan), 1e-6).fault.endswith("interfere")
        assert theirs or not ours or meets, (seed, ours, one.plan.text)


@search
@given(SEEDS)
def test_no_answer_about_a_step_or_a_goal_is_untrue(seed):
    one = task(seed)
    steps = one.plan.steps
    causes = Causes(Judge(one.domain, one.problem), steps)
    untrue = []
    for number, step in enumerate(steps):
        rest = [each for other, each in enumerate(steps) if other != number]
        needed = not right(one, rest)
        claims = (
            why(str(step), causes, Doing(), Words()).claims if causes.find(str(step))[0] == number else ()
        )
        for claim in claims:
            if claim.kind == "needless" and needed:
                untrue.append(claim)
            if claim.kind == "link" and not needed:
                untrue.append(claim)
        links = causes.links(number)
        if bool(links) != needed:
            untrue.append((number, links, needed))
        untrue += [link for link in links if not is_false_there(one, steps, link)]
        served = {to_pddl(goal) for goal in causes.goals_served(number)}
        lost = fallen(one, steps, number)
        if served != lost:
            untrue.append((number, served, lost))
    assert untrue == [], (seed, one.plan.text)


def fallen(one, steps, number):
    """The goals that are lost when a step and all that fail without it are left out, by force."""
    left = [step for each, step in enumerate(steps) if each != number]
    while True:
        actions = ground(one.model, left)
        events = planned_events(one.model, actions, times(left))
        fault = first_that_fails(one.model, actions, events)
        if fault is None:
            break
        left = [step for each, step in enumerate(left) if each != fault]
    state = played(one.model, actions, events)
    return {f"({fact[0]})" for fact in one.model.goal[1:] if tuple(fact) not in state.facts}


def first_that_fails(model, actions, events):
    for time in sorted({event.time for event in events}):
        before = played(model, actions, [each for each in events if each.time < time])
        after = played(model, actions, [each for each in events if each.time <= time])
        for event in (each for each in events if each.time == time and each.kind != "timed"):
            action = actions[event.action]
            needs = action.conditions["start" if not action.durative else event.kind]
            if (action.durative or event.kind == "end") and not all(
                model.holds(each, before) for each in needs
            ):
                return event.action
        ended = {each.action for each in events if each.kind == "end" and each.time <= time}
        begun = [each.action for each in events if each.kind == "start" and each.time <= time]
        for number in begun:
            needs = actions[number].conditions["all"]
            if number not in ended and not all(model.holds(each, after) for each in needs):
                return number
    return None


def played(model, actions, events):
    """The state after events, whatever fails."""
    state = model.initial.copy()
    for event in events:
        if event.kind == "timed":
            effects = [model.timed[event.action].effect]
        elif actions[event.action].durative:
            effects = actions[event.action].effects[event.kind]
        else:
            effects = actions[event.action].effects["start"] if event.kind == "end" else []
        state = model.apply(effects, state)
    return state


def is_false_there(one, steps, link):
    """Whether a link's condition is false where its taker needs it, its giver left out."""
    rest = [step for number, step in enumerate(steps) if number != link.giver]
    actions = ground(one.model, rest)
    events = planned_events(one.model, actions, times(rest))
    tree = parse(link.text)[0]
    if link.taker == GOAL:
        return not one.model.holds(tree, played(one.model, actions, events))
    begin, end = steps[link.taker].time, steps[link.taker].time + steps[link.taker].duration
    moments = {"start": [begin], "end": [end]}.get(link.when)
    if moments is not None:
        states = [played(one.model, actions, [each for each in events if each.time < at]) for at in moments]
    else:
        states = [
            played(one.model, actions, [each for each in events if each.time <= event.time])
            for event in events
            if begin <= event.time < end
        ]
    return any(not one.model.holds(tree, state) for state in states)
