# SPDX-License-Identifier: Apache-2.0
"""How well odometry and the particle filter know where a robot is, without ROS, as tables."""

import argparse
import math
import statistics
import sys
from typing import Iterator, List, Optional, Sequence, Tuple

import numpy as np

from matrices.trial import SCAN_EVERY, URDF, Trial, trials
from merlin_reactive.localization.particle_filter import FilterSettings, Localizer, ParticleFilter
from merlin_reactive.pose import Pose, wrap
from merlin_sim.engine.simulation import PHYSICS_RATE, RobotSpec, Simulation
from merlin_sim.robot.diff_drive import OdometryNoise
from merlin_sim.world.survey import map_of
from merlin_sim.world.world_file import find_world, load_world
from merlin_sim.world.world_model import World

DRIFTS = (
    ("none", OdometryNoise()),
    ("default (random, 0.005)", OdometryNoise(distance=0.005, turn=0.005)),
    ("poor (scale 2 %, random 0.01)", OdometryNoise(0.02, 0.02, 0.01, 0.01)),
)
SQUARE = (
    ((0.3, 0.0), 3.0),
    ((0.0, 0.0), 0.5),
    ((0.0, 1.0), math.pi / 2),
    ((0.0, 0.0), 0.75),
)  # m/s, rad/s; s
ROOM = Pose(1.6, 2.6)  # for the square, in the living room
TOUR = ("kitchen", "bathroom", "dorm_room")
LASER = Pose(0.0, 0.0)  # on the robot
FOUND = 0.25  # m and rad of error from which a robot counts as found
KNOWN = (0.15, 0.10)  # m, rad: how well a start is known


class GoalMissed(Exception):
    """A drive that ended elsewhere; the text says why."""


class Follower:
    """A particle filter beside a simulated robot: takes true poses, makes scans, returns the estimate.

    :param believed: where the filter believes that the robot starts; None: not known.
    :param leads: the robot drives by this belief; otherwise by the truth.
    """

    def __init__(self, trial: Trial, world: World, seed: int, believed: Optional[Pose], leads: bool) -> None:
        settings = FilterSettings()
        particles = ParticleFilter(map_of(world), settings, seed, "matrix")
        if believed is not None:
            particles.believe(believed, *KNOWN)
        self._localizer = Localizer(particles, settings)
        self._trial = trial
        self._leads = leads
        self._angles = -math.pi + trial.robot.lidar.increment * np.arange(trial.robot.lidar.model.rays)
        self.errors: List[Tuple[float, float, float]] = []  # s, m, rad

    def estimate(self, truth: Pose, time: float) -> Pose:
        """What the robot drives by."""
        simulation, odometry = self._trial.simulation, self._trial.robot.odometry.pose
        if simulation.tick % SCAN_EVERY == 0:
            ranges = simulation.scan(self._trial.robot)
            self._localizer.update(odometry, LASER, self._angles, ranges)
        belief = self._localizer.map_to_odom.compose(odometry)
        self.errors.append((time, belief.distance(truth), abs(wrap(belief.yaw - truth.yaw))))
        return belief if self._leads else truth


def found_after(errors: Sequence[Tuple[float, float, float]]) -> float:
    """When the filter knew where the robot was and did not lose it again, s; infinite: it never did.

    :param errors: s, m, rad.
    """
    lost = [time for time, error, turn in errors if error > FOUND or turn > FOUND]
    return math.inf if lost and lost[-1] == errors[-1][0] else (lost[-1] if lost else 0.0)


def odometry_errors(world: World, noise: OdometryNoise, seed: int) -> Tuple[float, float]:
    """Errors (m, rad) of odometry after a square of 3.4 m."""
    start = ROOM
    simulation = Simulation(world, [RobotSpec("", start, odometry_noise=noise)], URDF, seed)
    try:
        robot = simulation.robots[""]
        for (speed, turn), duration in SQUARE * 4:
            for _ in range(round(duration * PHYSICS_RATE)):
                robot.base.command(speed, turn, simulation.time)
                simulation.step()
        truth, believed = start.inverse().compose(robot.body.pose()), robot.odometry.pose
        return truth.distance(believed), abs(wrap(truth.yaw - believed.yaw))
    finally:
        simulation.close()


def tour(world: World, noise: OdometryNoise, seed: int, believed: Optional[Pose], leads: bool) -> Follower:
    """Drives from the main door over three rooms, with a filter that begins with a belief.

    :raises GoalMissed: the robot that drives by it does not arrive.
    """
    start = world.points_of_interest["main_door"]
    trial = Trial(world, start, seed, odometry=noise)
    try:
        trial.localization = follower = Follower(trial, world, seed, believed, leads)
        for name in TOUR if leads else TOUR[:1]:
            result = trial.drive(world.points_of_interest[name])
            if leads and not result.reached:
                raise GoalMissed(f"seed {seed}: {name} was not reached: {result.text}")
        return follower
    finally:
        trial.close()


def odometry_rows(world: World, seeds: int) -> Iterator[str]:
    """The table of odometry."""
    yield "| drift | error of the position, mean, cm | worst, cm | worst heading |\n|---|---|---|---|"
    for name, noise in DRIFTS:
        errors = [odometry_errors(world, noise, seed) for seed in range(1, seeds + 1)]
        metres, turns = zip(*errors)
        yield (
            f"| {name} | {100 * statistics.mean(metres):.2f} | {100 * max(metres):.2f} "
            f"| {math.degrees(max(turns)):.2f}° |"
        )


def particle_rows(world: World, seeds: int) -> Iterator[str]:
    """The tables of the particle filter."""
    yield "| drift | error of the position, mean, cm | 95th percentile, cm | of the heading, mean |"
    yield "|---|---|---|---|"
    start = world.points_of_interest["main_door"]
    for name, noise in DRIFTS[1:]:
        runs = [tour(world, noise, seed, start, True) for seed in range(1, seeds + 1)]
        errors = [error for run in runs for error in run.errors]
        metres = [100 * metre for _, metre, _ in errors]
        turns = statistics.mean(turn for _, _, turn in errors)
        yield (
            f"| {name} | {statistics.mean(metres):.1f} | {np.percentile(metres, 95):.1f} "
            f"| {math.degrees(turns):.1f}° |"
        )
    yield "\n| believes at first to be | found | after, s of driving |\n|---|---|---|"
    for name, believed in (
        ("0.7 m beside it", Pose(start.x + 0.5, start.y + 0.5, start.yaw)),
        ("in another room", world.points_of_interest["bathroom"]),
        ("anywhere", None),
    ):
        runs = [tour(world, DRIFTS[1][1], seed, believed, False) for seed in range(1, seeds + 1)]
        times = sorted(found_after(run.errors) for run in runs)
        yield (
            f"| {name} | {sum(map(math.isfinite, times))}/{len(times)} "
            f"| {', '.join(f'{time:.1f}' for time in times)} |"
        )


def main(arguments: Optional[List[str]] = None) -> int:
    """Prints the table; returns its exit code."""
    parser = argparse.ArgumentParser(prog="bench/matrices positioning", description=__doc__)
    parser.add_argument("--seeds", type=trials, default=3, help="runs per row (default 3)")
    parser.add_argument("--part", choices=["odometry", "particles"], help="only this part")
    options = parser.parse_args(arguments)
    world = load_world(find_world("apartment"))
    parts = {"odometry": odometry_rows, "particles": particle_rows}
    for name, rows in parts.items():
        if options.part not in (None, name):
            continue
        try:
            for row in rows(world, options.seeds):
                print(row, flush=True)
        except GoalMissed as error:
            print(f"positioning_matrix: {error}", file=sys.stderr)
            return 1
        print()
    return 0
