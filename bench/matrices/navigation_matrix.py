# SPDX-License-Identifier: Apache-2.0
"""The matrix of navigation cases: how often each ends as it should, over seeds. See docs/simulation.md."""

import argparse
import statistics
import sys
from typing import Iterator, List, Optional, Tuple

from matrices.navigation_cases import Case, cases
from matrices.trial import Trial, TrialResult, trials
from merlin_reactive.navigation.navigator import NavigationSettings
from merlin_reactive.navigation.path_follower import Cruise
from merlin_sim.world.world_file import WorldError, find_world, load_world
from merlin_sim.world.world_model import World


def run(world: World, case: Case, seeds: int, speed: float) -> Iterator[Tuple[str, TrialResult]]:
    """The trials of a case at a cruising speed (m/s), one per seed and leg."""
    settings = NavigationSettings(yaw_goal_tolerance=case.yaw_tolerance, cruise=Cruise(speed=speed))
    for seed in range(1, seeds + 1):
        changed = case.change(world, seed)
        for name, start, goal in case.legs(world):
            trial = Trial(changed, start, seed, settings)
            try:
                yield f"{name}, seed {seed}", trial.drive(goal)
            finally:
                trial.close()


def main(arguments: Optional[List[str]] = None) -> int:
    """Prints the table; returns 1 when a trial did not end as it should."""
    parser = argparse.ArgumentParser(prog="bench/matrices navigation", description=__doc__)
    parser.add_argument("--world", default="apartment", help="name or file of a world (default apartment)")
    parser.add_argument("--speed", type=float, default=0.3, help="cruising speed, m/s (default 0.3)")
    parser.add_argument("--seeds", type=trials, default=3, help="trials per case and leg (default 3)")
    parser.add_argument("--case", help="only the cases whose name contains this")
    options = parser.parse_args(arguments)
    try:
        world = load_world(find_world(options.world))
    except WorldError as error:
        print(f"navigation_matrix: {error}", file=sys.stderr)
        return 1
    chosen = [case for case in cases(world.name) if (options.case or "") in case.name]
    if not chosen:
        parser.error(f"no case of {world.name} contains {options.case!r}")
    if not options.speed > 0.0:
        parser.error(f"a speed of {options.speed:g} m/s gets nowhere")
    wrong = []
    print("| case | as it should | collisions | time, s (median) | distance, m (median) | waited, s (mean) |")
    print("|---|---|---|---|---|---|")
    for case in chosen:
        results = list(run(world, case, options.seeds, options.speed))
        right = [result.outcome is case.expected and not result.collisions for _, result in results]
        wrong += [
            f"{case.name}, {name}: {result.outcome.value}, {result.collisions} collisions, {result.text}"
            for (name, result), good in zip(results, right)
            if not good
        ]
        values = [result for _, result in results]
        print(
            f"| {case.name} | {sum(right)}/{len(right)} | {sum(value.collisions for value in values)} "
            f"| {statistics.median(value.time for value in values):.1f} "
            f"| {statistics.median(value.distance for value in values):.2f} "
            f"| {statistics.mean(value.waited for value in values):.1f} |",
            flush=True,
        )
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0
