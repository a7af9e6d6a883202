#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Driving against the best possible, without ROS: a tour over all ways between the points of interest, and
the drives of a mission, half of which are cut short and the robot sent elsewhere.

The robot drives with the reactive layer's navigation in a simulated apartment, as fast as that computes; the
oracle is the experiment's. Equal seeds give equal figures on every machine.
"""

import itertools
import math
import statistics
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Dict, Iterator, List, Sequence, Tuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from matrices.trial import Trial, TrialResult
from measuring.figures import figure

from merlin_experiment.oracle.motion_limits import MotionLimits
from merlin_experiment.oracle.oracle import Oracle, OracleResult
from merlin_experiment.oracle.outlines import outlines_of_world
from merlin_experiment.oracle.shortest_path import ShortestPaths
from merlin_home.mission_list import make_mission, mission_tasks
from merlin_reactive.navigation.navigator import NavigationSettings
from merlin_sim.world.world_file import find_world, load_world
from merlin_sim.world.world_model import World

SEEDS = (1, 2, 3)
TICK = 0.05  # s between the samples of a trial
CUT_AFTER = 10.0  # s; when a mission cancels
SENT_ON = 10  # physics steps from a stop to the next drive
MOVING = (0.01, 0.02)  # m/s, rad/s from which the robot counts as moving
AT_CRUISE = 0.97  # part of the cruising speed from which it counts as driving at full speed


@dataclass(frozen=True)
class Leg:
    """One drive: s and m, and where the time beyond the oracle's went (s; the parts sum up to the loss).

    :ivar start: before the first motion.
    :ivar turn: until the first full speed, beyond what the oracle needs to turn and to set off.
    :ivar way: driven beyond the shortest path.
    :ivar curve: slower than full speed between the first and the last of it.
    :ivar end: after the last full speed, beyond the oracle's braking.
    """

    time: float
    distance: float
    oracle_time: float
    oracle_distance: float
    start: float
    turn: float
    way: float
    curve: float
    end: float
    collisions: int


def measure() -> Dict[str, Any]:
    """The figures of all seeds."""
    world = load_world(find_world("apartment"))
    results: Dict[str, Any] = {}
    for name, drives in (("driving", tour), ("driving_mission", mission)):
        results.update(_figures(name, [leg for seed in SEEDS for leg in drives(world, seed)]))
    return results


def _figures(name: str, legs: List[Leg]) -> Dict[str, Any]:
    time, distance = sum(leg.time for leg in legs), sum(leg.distance for leg in legs)
    results: Dict[str, Any] = {
        f"{name}_efficiency_time": round(sum(leg.oracle_time for leg in legs) / time, 4),
        f"{name}_efficiency_distance": round(sum(leg.oracle_distance for leg in legs) / distance, 4),
        f"{name}_collisions": sum(leg.collisions for leg in legs),
        f"{name}_loss_s": _spread([leg.time - leg.oracle_time for leg in legs]),
    }
    for part in ("start", "turn", "way", "curve", "end"):
        results[f"{name}_loss_{part}_s"] = _spread([getattr(leg, part) for leg in legs])
    return results


def tour(world: World, seed: int) -> Iterator[Leg]:
    """Drives each way between two points of interest once, in one go: headings are as they come.

    :raises RuntimeError: a drive failed.
    """
    stops = _round_trip(list(world.points_of_interest))
    return _drives(world, seed, stops[0], [(name, False) for name in stops[1:]])


def mission(world: World, seed: int) -> Iterator[Leg]:
    """Drives the list of a Mission 2; only the drives that are not cut short are measured.

    :raises RuntimeError: a drive failed.
    """
    tasks = make_mission(list(world.points_of_interest), mission_tasks(2), seed)
    drives = [(task.poi, task.marked) for task in tasks]
    start = next(name for name in world.points_of_interest if name != drives[0][0])
    return _drives(world, seed, start, drives)


def _drives(world: World, seed: int, start: str, drives: Sequence[Tuple[str, bool]]) -> Iterator[Leg]:
    """Drives to points, and away from those that are cut short after CUT_AFTER seconds."""
    limits = MotionLimits()
    settings = NavigationSettings(yaw_goal_tolerance=math.pi)
    paths = ShortestPaths(outlines_of_world(world), limits.radius)
    oracle = Oracle(paths, limits, 0.0, settings.xy_goal_tolerance)
    trial = Trial(world, world.points_of_interest[start], seed, settings)
    try:
        for name, cut in drives:
            goal = world.points_of_interest[name]
            if cut:
                trial.drive(goal, CUT_AFTER)
                trial.robot.base.command(0.0, 0.0, trial.simulation.time)
                for _ in range(SENT_ON):
                    trial.simulation.step()
                continue
            here, motion = trial.robot.body.pose(), trial.robot.body.velocity()
            result = trial.drive(goal)
            if not result.reached:
                raise RuntimeError(f"to {name}, seed {seed}: {result.text}, {result.collisions} collisions")
            yield _leg(result, oracle.task(here.point, here.yaw, goal.point, motion=motion), limits)
    finally:
        trial.close()


def _leg(result: TrialResult, best: OracleResult, limits: MotionLimits) -> Leg:
    deficits = [(1.0 - speed / limits.speed) * TICK for speed, _ in result.speeds]
    moving = [abs(speed) > MOVING[0] or abs(turn) > MOVING[1] for speed, turn in result.speeds]
    cruising = [speed >= AT_CRUISE * limits.speed for speed, _ in result.speeds]
    if True not in cruising:
        raise RuntimeError("a way too short to reach full speed says nothing")
    set_off, first = moving.index(True), cruising.index(True)
    last = len(cruising) - cruising[::-1].index(True)
    braking = limits.speed / limits.acceleration / 2  # s that braking takes beyond driving the same way on
    begun = sum(deficits[:set_off])
    whole = result.time - best.time
    way = (result.distance - best.distance) / limits.speed
    turn = sum(deficits[set_off:first]) - (best.time - best.distance / limits.speed - braking)
    curve = sum(deficits[first:last])
    return Leg(
        time=result.time,
        distance=result.distance,
        oracle_time=best.time,
        oracle_distance=best.distance,
        start=begun,
        turn=turn,
        way=way,
        curve=curve,
        end=whole - begun - turn - way - curve,  # what sampling leaves over is here too
        collisions=result.collisions,
    )


def _round_trip(names: List[str]) -> List[str]:
    """A closed tour with each ordered pair of names once (Hierholzer's algorithm)."""
    ahead = {name: [other for other in names if other != name] for name in names}
    stack, tour = [names[0]], []
    while stack:
        if ahead[stack[-1]]:
            stack.append(ahead[stack[-1]].pop())
        else:
            tour.append(stack.pop())
    return tour[::-1]


def _spread(values: List[float]) -> Dict[str, float]:
    return {**figure(values), "mean": round(statistics.mean(values), 3)}


def main() -> int:
    """Prints every leg and the mean of all; returns 0."""
    world = load_world(find_world("apartment"))
    names = [field.name for field in fields(Leg)]
    for drives in (tour, mission):
        print(drives.__name__)
        print("".join(f"{name:>16}" for name in names))
        legs: List[Leg] = []
        for leg in itertools.chain.from_iterable(drives(world, seed) for seed in SEEDS):
            legs.append(leg)
            print("".join(f"{getattr(leg, name):16.3f}" for name in names), flush=True)
        means = [statistics.mean(getattr(leg, name) for leg in legs) for name in names]
        print("".join(f"{value:16.3f}" for value in means))
        print(f"efficiency {means[2] / means[0]:.4f} (time), {means[3] / means[1]:.4f} (distance)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
