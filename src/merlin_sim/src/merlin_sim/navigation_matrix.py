"""The matrix of navigation cases: how often each ends as it should, over seeds. See docs/simulation.md."""

import argparse
import dataclasses
import itertools
import math
import statistics
import sys
from dataclasses import dataclass
from typing import Callable, Iterator, List, Optional, Tuple

from merlin_sim.navigator import NavigationSettings, Outcome
from merlin_sim.noise import draw
from merlin_sim.trial import Trial, TrialResult
from merlin_sim.world import DoorEvent, MoveEvent, Person, Pose, Solid, World
from merlin_sim.world_drawing import find_world
from merlin_sim.world_file import WorldError, load_world

Leg = Tuple[str, Pose, Pose]


@dataclass(frozen=True)
class Case:
    """A kind of situation.

    :param change: makes the world of one trial from the apartment and a seed.
    :param legs: what is driven.
    :param expected: how it has to end.
    """

    name: str
    change: Callable[[World, int], World]
    legs: Callable[[World], List[Leg]]
    expected: Outcome = Outcome.REACHED


def cases() -> List[Case]:
    """All cases, made for the apartment."""
    return [
        Case("free", lambda world, seed: world, _all_legs),
        Case("box in the way", _box, _between("dorm_room", "bathroom")),
        Case("furniture moved", _moved, _between("dorm_room", "kitchen")),
        Case("person stands in the way", _standing, _between("main_door", "bathroom")),
        Case("person crosses", _crossing, _between("dorm_room", "bathroom")),
        Case("person comes towards it", _oncoming, _between("bathroom", "main_door")),
        Case("door closes and opens again", _reopened, _between("dorm_room", "kitchen")),
        Case("door closes for good", _closed, _between("dorm_room", "kitchen"), Outcome.NO_PLAN),
        Case("goal taken", _goal_taken, _between("dorm_room", "main_door"), Outcome.NO_PLAN),
    ]


def run(world: World, case: Case, seeds: int) -> Iterator[Tuple[str, TrialResult]]:
    """The trials of a case, one per seed and leg."""
    for seed in range(1, seeds + 1):
        changed = case.change(world, seed)
        for name, start, goal in case.legs(world):
            trial = Trial(changed, start, seed, NavigationSettings(yaw_goal_tolerance=math.pi))
            try:
                yield f"{name}, seed {seed}", trial.drive(goal)
            finally:
                trial.close()


def main(arguments: Optional[List[str]] = None) -> int:
    """The command ``navigation_matrix``; returns 1 when a trial did not end as it should."""
    parser = argparse.ArgumentParser(prog="navigation_matrix", description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="trials per case and leg (default 3)")
    parser.add_argument("--case", help="only the cases whose name contains this")
    options = parser.parse_args(arguments)
    try:
        world = load_world(find_world("apartment"))
    except WorldError as error:
        print(f"navigation_matrix: {error}", file=sys.stderr)
        return 1
    wrong = []
    print("| case | as it should | collisions | time, s (median) | distance, m (median) | waited, s (mean) |")
    print("|---|---|---|---|---|---|")
    for case in cases():
        if options.case and options.case not in case.name:
            continue
        results = list(run(world, case, options.seeds))
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


def _all_legs(world: World) -> List[Leg]:
    points = world.points_of_interest
    return [(f"{a} to {b}", points[a], points[b]) for a, b in itertools.permutations(points, 2)]


def _between(start: str, goal: str) -> Callable[[World], List[Leg]]:
    def legs(world: World) -> List[Leg]:
        points = world.points_of_interest
        return [(f"{start} to {goal}", points[start], points[goal])]

    return legs


def _jitter(seed: int, name: str, size: float) -> Tuple[float, float]:
    x, y = draw(seed, name, 0).uniform(-size, size, 2)
    return float(x), float(y)


def _box(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "box", 0.25)
    box = Solid("box", Pose(4.8 + dx, 3.75 + dy, dx), 0.5, size=(0.5, 0.4))
    return dataclasses.replace(world, unmapped=[box])


def _moved(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "table", 0.2)
    event = MoveEvent(2.0, "dining_table", Pose(4.5 + dx, 3.2 + dy, dy))
    return dataclasses.replace(world, events=[event])


def _standing(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "person", 0.3)
    return dataclasses.replace(world, people=[Person("ann", ((4.2 + dx, 3.6 + dy),))])


def _crossing(world: World, seed: int) -> World:
    dx, _ = _jitter(seed, "person", 0.5)
    path = ((4.8 + dx, 5.6), (4.8 + dx, 3.2))
    return dataclasses.replace(world, people=[Person("ann", path, speed=0.8, delay=seed % 5, pause=1.0)])


def _oncoming(world: World, seed: int) -> World:
    dx, _ = _jitter(seed, "person", 0.4)
    path = ((1.5, 2.6), (5.4 + dx, 3.7))
    return dataclasses.replace(world, people=[Person("ann", path, speed=0.6, delay=6 + seed % 5, pause=3.0)])


def _reopened(world: World, seed: int) -> World:
    events = [DoorEvent(3.0, "kitchen_door", False), DoorEvent(26.0 + seed % 5, "kitchen_door", True)]
    return dataclasses.replace(world, events=events)


def _closed(world: World, seed: int) -> World:
    return dataclasses.replace(world, events=[DoorEvent(3.0 + seed % 5, "kitchen_door", False)])


def _goal_taken(world: World, seed: int) -> World:
    dx, dy = _jitter(seed, "goal", 0.1)
    goal = world.points_of_interest["main_door"]
    return dataclasses.replace(world, people=[Person("ann", ((goal.x + dx, goal.y + dy),))])
