# SPDX-License-Identifier: Apache-2.0
"""Random domains, and random plans that are valid in them."""

import random
from typing import List, NamedTuple, Tuple

from pddl21 import Model
from semantics import validate

from merlin_pddl.plan_text import PlanStep

FACTS = [f"f{number}" for number in range(5)]
NUMBERS = [f"n{number}" for number in range(2)]
TRIES = 60


class RandomPlan(NamedTuple):
    """A valid plan, its domain as text, and the bounds of the duration of each of its actions, s."""

    sections: str
    init: str
    timed: str
    steps: List[PlanStep]
    bounds: List[Tuple[float, float]]

    @property
    def model(self) -> Model:
        return Model(self.sections, "", f"{self.init} {self.timed}", "(and)")

    @property
    def text(self) -> str:
        lines = "\n".join(f"{s.time:.3f}: {s} [{s.duration:.3f}]" for s in self.steps)
        return f"{self.sections}\n{self.init} {self.timed}\n{lines}\n{self.bounds}"


def random_plan(
    rng: random.Random, length: int, flexible: bool, timed: bool, epsilon: float = 0.001
) -> RandomPlan:
    """:param flexible: whether durations may differ from the planned ones.
    :param timed: whether facts and values change by themselves.
    :param epsilon: s, at least, between happenings that interfere.
    """
    count = rng.randint(2, 5)
    operators = [_operator(rng, number) for number in range(count)]
    # at least a range for each, so that a wait for one end is worth it
    bounds = []
    for durative, _ in operators:
        least = round(rng.uniform(0.5, 10.0), 1)
        most = round(least * rng.uniform(1.0, 6.0), 1) if flexible and rng.random() < 0.6 else least
        bounds.append((least, most) if durative else (0.001, 0.001))
    sections = (
        f"(:predicates {' '.join(f'({fact})' for fact in FACTS)}) "
        f"(:functions {' '.join(f'({number})' for number in NUMBERS)})\n"
        + "\n".join(
            text.replace("DURATION", _duration(*bound)) for (_, text), bound in zip(operators, bounds)
        )
    )
    init = " ".join(f"({fact})" for fact in FACTS if rng.random() < 0.5)
    init += " " + " ".join(f"(= ({number}) {rng.randint(0, 5)})" for number in NUMBERS)
    changes = ""
    if timed:
        for _ in range(rng.randint(1, 3)):
            at = round(rng.uniform(1, 20), 3)
            fact = rng.choice(FACTS)
            changes += rng.choice(
                [
                    f"(at {at} ({fact})) ",
                    f"(at {at} (not ({fact}))) ",
                    f"(at {at} (= ({rng.choice(NUMBERS)}) {rng.randint(0, 9)})) ",
                ]
            )
    plan = RandomPlan(sections, init, changes, [], [])
    model = plan.model
    for _ in range(TRIES):
        if len(plan.steps) >= length:
            break
        number = rng.randrange(count)
        least, most = bounds[number]
        # close to what is there, where the interesting overlaps are
        marks = [0.0] + [t for s in plan.steps for t in (s.time, s.time + s.duration)]
        time = max(0.0, rng.choice(marks) + rng.choice([0.0, 0.001, 0.01, rng.uniform(-4, 6)]))
        step = PlanStep(round(time, 3), f"a{number}", (), round(rng.uniform(least, most), 3))
        steps = sorted([*plan.steps, step], key=lambda each: each.time)
        actions = [model.ground(each.name, ()) for each in steps]
        if not validate(model, actions, [(each.time, each.duration) for each in steps], epsilon).fault:
            plan = plan._replace(steps=steps, bounds=[bounds[int(each.name[1:])] for each in steps])
    return plan


def _duration(least: float, most: float) -> str:
    if least == most:
        return f"(= ?duration {least})"
    return f"(and (>= ?duration {least}) (<= ?duration {most}))"


def _operator(rng: random.Random, number: int) -> Tuple[bool, str]:
    durative = rng.random() < 0.75
    conditions = [_condition(rng) for _ in range(rng.choice([0, 1, 1, 2]))]
    effects = [_effect(rng) for _ in range(rng.choice([1, 1, 2, 3]))]
    if not durative:
        return False, (
            f"(:action a{number} :parameters () :precondition (and {' '.join(conditions)}) "
            f":effect (and {' '.join(effects)}))"
        )
    when = ["at start", "at start", "over all", "at end"]
    needs = [(rng.choice(when), each) for each in conditions]
    brings = [(rng.choice(["at start", "at end"]), each) for each in effects]
    timed_conditions = " ".join(f"({time} {each})" for time, each in needs)
    timed_effects = " ".join(f"({time} {each})" for time, each in brings)
    return True, (
        f"(:durative-action a{number} :parameters () :duration DURATION "
        f":condition (and {timed_conditions}) :effect (and {timed_effects}))"
    )


def _condition(rng: random.Random) -> str:
    kind = rng.random()
    fact = f"({rng.choice(FACTS)})"
    if kind < 0.5:
        return fact
    if kind < 0.7:
        return f"(not {fact})"
    if kind < 0.9:
        return f"({rng.choice(['>=', '<=', '>'])} ({rng.choice(NUMBERS)}) {rng.randint(0, 6)})"
    return f"(or {fact} (not ({rng.choice(FACTS)})))"


def _effect(rng: random.Random) -> str:
    kind = rng.random()
    fact = f"({rng.choice(FACTS)})"
    if kind < 0.4:
        return fact
    if kind < 0.7:
        return f"(not {fact})"
    if kind < 0.95:
        op = rng.choice(["increase", "decrease", "assign"])
        value = rng.choice([str(rng.randint(1, 3)), f"({rng.choice(NUMBERS)})"])
        return f"({op} ({rng.choice(NUMBERS)}) {value})"
    return f"(when ({rng.choice(FACTS)}) {fact})"
