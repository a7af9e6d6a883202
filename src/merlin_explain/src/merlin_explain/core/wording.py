# SPDX-License-Identifier: Apache-2.0
"""Parts of sentences and of evidence that several answers have."""

from typing import Sequence

from merlin_explain.claims import PLAN, STEP, Evidence
from merlin_pddl.plan_text import PlanStep, format_plan

#: How many steps of a plan are written into a sentence.
SHOWN = 8


def and_list(texts: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(texts[:-1]), *texts[-1:]]))


def steps_text(steps: Sequence[PlanStep]) -> str:
    """The steps of a plan as PDDL, in their order."""
    more = f", … ({len(steps)} steps)" if len(steps) > SHOWN else ""
    return ", ".join(map(str, steps[:SHOWN])) + more


def step_evidence(number: int, steps: Sequence[PlanStep]) -> Evidence:
    """A step of a plan.

    :param number: from 0.
    """
    return Evidence(STEP, str(steps[number]), number + 1, time=steps[number].time)


def plan_evidence(steps: Sequence[PlanStep]) -> Evidence:
    """A whole plan."""
    return Evidence(PLAN, format_plan(steps).strip() or "no steps")


def plain(text: str) -> str:
    """An action as plans write it, in small letters."""
    return f"({' '.join(text.lower().strip('() ').split())})"


def steps_count(steps: Sequence[PlanStep]) -> str:
    """``1 step``, ``2 steps``."""
    return f"{len(steps)} step{'' if len(steps) == 1 else 's'}"
