# SPDX-License-Identifier: Apache-2.0
"""Whatever the durations, an execution keeps to PDDL: random domains, plans and durations.

A dispatch that succeeds was right: every condition was true when it had to be, and what holds at the end is
what the plan makes true. Durations decide only whether it succeeds, and that only where a plan needs actions
to run at the same time: there nothing else orders their ends.
"""

import random

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from random_plans import random_plan
from semantics import judge, validate
from simulation import Planned, World

from merlin_rosplan.dispatch.dispatch_environment import DispatchState

SEEDS = st.integers(0, 2**32)
MARGIN = 0.2  # s: what a dispatcher needs between two happenings, with room
# The same seeds each time: what a random search finds becomes an example below.
search = settings(max_examples=150, derandomize=True, suppress_health_check=list(HealthCheck))


def within(rng, least, most):
    return rng.uniform(least, most)


def anything(rng, least, most):
    return rng.uniform(least, most) * 10 ** rng.uniform(-1, 1)


def check(seed, kind, flexible, timed, spread, epsilon=0.001):
    """:param spread: draws a duration from its bounds."""
    rng = random.Random(seed)
    plan = random_plan(rng, rng.randint(2, 8), flexible, timed, epsilon)
    model = plan.model
    planned = Planned.make(plan.sections, model, plan.steps)
    wanted = validate(model, planned.actions, [(s.time, s.duration) for s in plan.steps]).state
    durations = [spread(rng, *bound) for bound in plan.bounds]
    outcome = World(planned, durations, rng).run(kind)
    verdict = judge(model, planned.actions, outcome.events)
    told = f"seed {seed}\n{plan.text}\n{durations}\n{outcome}\n{verdict}"
    return outcome, verdict, wanted, told


# 500379: a change of a number by one start was taken for that of another one.
@pytest.mark.parametrize("seeds", [*(range(n, n + 50) for n in range(0, 200, 50)), [500379]], ids=str)
def test_a_plan_with_its_durations_is_carried_out(seeds):
    for seed in seeds:
        outcome, verdict, wanted, told = check(seed, "esterel", False, False, within, MARGIN)
        assert outcome.report.success, told
        assert not verdict.fault, told
        assert outcome.state == wanted, told


@pytest.mark.parametrize("first", range(0, 200, 50))
def test_a_plan_with_timed_changes_is_carried_out(first):
    for seed in range(first, first + 50):
        outcome, verdict, _, told = check(seed, "esterel", False, True, within, MARGIN)
        assert outcome.report.success, told
        assert not verdict.fault, told


@pytest.mark.parametrize("spread", [within, anything])
@pytest.mark.parametrize("kind", ["esterel", "simple"])
@search
@example(1441)
@example(254)
@given(SEEDS)
def test_a_dispatch_that_succeeds_was_right_whatever_its_durations(kind, spread, seed):
    outcome, verdict, wanted, told = check(seed, kind, True, False, spread)
    if outcome.report.success:
        assert not verdict.fault, told
        assert kind == "simple" or outcome.state == wanted, told
    else:
        assert outcome.report.state == DispatchState.FAILED and outcome.report.reason, told


def test_most_plans_succeed_whatever_their_durations():
    runs = [check(seed, "esterel", True, False, anything)[0].report.success for seed in range(150)]
    assert sum(runs) > 0.9 * len(runs)
