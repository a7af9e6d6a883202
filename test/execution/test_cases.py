# SPDX-License-Identifier: Apache-2.0
"""The conformance cases on both dispatchers: durations as planned, ten times slower, faster, random."""

import random
import re

import pytest
from cases import CASES, failure_of, plan_of, sections
from pddl21 import Model
from semantics import judge
from simulation import Planned, World

PACES = {
    "planned": lambda rng: 1.0,
    "slow": lambda rng: 10.0,
    "fast": lambda rng: 0.1,
    **{f"random {seed}": lambda rng: 10 ** rng.uniform(-1, 1) for seed in range(3)},
}


@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("kind", ["simple", "esterel"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case, kind, pace):
    text = sections(case.domain)
    model = Model(text, "", case.init, case.goal)
    steps = plan_of(case)
    planned = Planned.make(text, model, steps)
    rng = random.Random(f"{case.name} {pace}")
    factors = [PACES[pace](rng) for _ in steps]
    durations = [step.duration * factor for step, factor in zip(steps, factors)]
    outcome = World(planned, durations, rng).run(kind)
    told = f"{outcome}\n{durations}"
    failure = failure_of(case, kind)
    drift = "drift" in case.expect.split()
    if failure is not None:
        assert not outcome.report.success and failure in outcome.report.reason, told
        return
    if not outcome.report.success:
        assert drift and (kind, pace) != ("esterel", "planned") and outcome.report.reason, told
        return
    verdict = judge(model, planned.actions, outcome.events)
    assert not verdict.fault, f"{verdict}\n{told}"
    assert model.holds(model.goal, outcome.state), told
    if kind == "simple" and drift:
        return
    times = {f"{e.action}{e.kind[0]}": e.time for e in outcome.events if e.kind != "timed"}
    for first, sign, second in re.findall(r"(\d+[se])([<>])(\S+)", case.expect):
        limit = times[second] if second in times else float(second)
        assert (times[first] < limit) == (sign == "<"), f"{first}{sign}{second}\n{told}"
    if kind == "esterel" and pace == "planned":
        for one, other in re.findall(r"(\d+)\|(\d+)", case.expect):
            assert times[f"{one}s"] < times[f"{other}e"] and times[f"{other}s"] < times[f"{one}e"], told
