#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints the table of docs/planners.md: ten problems by engine.

Usage: bench/planning/engines.py [--limit S] [--anytime S] [engine ...]     for example: … kairos symk
"""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from measuring.tables import markdown

from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.plan_text import parse_plan
from merlin_rosplan.planning.planner import PlannerSettings
from merlin_rosplan.planning.planning_outcome import PlannerState
from merlin_rosplan.supervision.supervised_planning import Planning
from planning.engine_problems import problems

ENGINES = ["kairos", "fast-downward", "symk", "lpg", "enhsp", "kairos+symk"]


def cell(engine: str, domain: str, problem: str, folder: Path, limit: float, anytime: float) -> str:
    """How one engine fares: the plan's metric (or its length in s) and the time, or why there is no plan."""
    (folder / "domain.pddl").write_text(domain)
    (folder / "problem.pddl").write_text(problem)
    settings = PlannerSettings(engine, fallback=False, time_limit=limit, anytime=anytime)
    outcome = Planning(settings, str(folder / "domain.pddl"), str(folder / "problem.pddl")).run()
    if outcome.state != PlannerState.SOLVED:
        print(f"    {engine}: {outcome.state.name}: {outcome.reason[:150]}", flush=True)
        return f"{outcome.state.name}, {outcome.seconds:.1f} s"
    steps = parse_plan(outcome.plan)
    quality = PlanValidator(domain, problem).quality(steps)
    metric = quality.metric if quality.metric is not None else quality.actions
    return f"{abs(metric):g}, {outcome.seconds:.2f} s"


def main() -> None:
    """Runs the problems and prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("engines", nargs="*", default=ENGINES)
    parser.add_argument("--limit", type=float, default=10.0)
    parser.add_argument("--anytime", type=float, default=PlannerSettings().anytime)
    given = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(prefix="engines-") as name:
        for title, (domain, problem) in problems().items():
            print(title, flush=True)
            cells = [
                cell(engine, domain, problem, Path(name), given.limit, given.anytime)
                for engine in given.engines
            ]
            rows.append([title, *cells])
    print(markdown(["problem", *given.engines], rows))


if __name__ == "__main__":
    main()
